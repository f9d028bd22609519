// SPDX-License-Identifier: Apache-2.0
// Privileged observations. Frames are 50 ms apart (50 ns short of it), so that 1 cm in a frame is
// 0.2 m/s, of which the hammer's filter shows a half at first.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <vector>

#include "sim2vr/core/errors.hpp"
#include "whacamole/game.hpp"
#include "whacamole_player.hpp"

namespace sim2vr::games::whacamole {
namespace {

class Observed {
 public:
  explicit Observed(const rl::RLEnv& env) : values_(Privileged::names().size()) {
    env.fillPrivileged(values_);
  }
  explicit Observed(WhacAMoleRound& round) : Observed(round.harness.env()) {}

  double operator()(const std::string& name) const {
    const auto& names = Privileged::names();
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) throw std::out_of_range(name);
    return static_cast<double>(values_[static_cast<std::size_t>(found - names.begin())]);
  }
  Vec3 vector(const std::string& name, const std::string& unit) const {
    return {(*this)(name + "x" + unit), (*this)(name + "y" + unit), (*this)(name + "z" + unit)};
  }
  int present() const {
    int count = 0;
    for (int cell = 0; cell < kCells; ++cell) {
      count += static_cast<int>((*this)("cell" + std::to_string(cell) + ".present"));
    }
    return count;
  }

 private:
  std::vector<float> values_;
};

constexpr double kFloat = 1e-5;

TEST(Privileged, NamesAreUniqueAndAidsComeLast) {
  const WhacAMole game;
  const auto& names = game.privilegedNames();
  // 7 of the round, 17 of the hammer, 7 for each of 9 cells, 3 next and 1 nearest target, 7 aids.
  ASSERT_EQ(names.size(), 7U + 17U + 7U * 13U + 7U);
  EXPECT_EQ(std::set<std::string>(names.begin(), names.end()).size(), names.size());
  for (std::size_t i = 0; i < names.size(); ++i) {
    EXPECT_EQ(names[i].starts_with("aid."), i + 7 >= names.size()) << names[i];
  }
}

TEST(Privileged, NeedsOnePlacePerName) {
  WhacAMoleRound round("{}");
  round.idle();
  std::vector<float> few(3);
  EXPECT_THROW(round.harness.env().fillPrivileged(few), InvalidArgument);
}

TEST(Privileged, Round) {
  WhacAMoleRound low(R"({"condition": "low-easy", "strike_threshold_mps": 0.5})");
  low.idle(21);
  const Observed observed(low);
  EXPECT_EQ(observed("round.low"), 1.0);
  EXPECT_EQ(observed("round.mid"), 0.0);
  EXPECT_EQ(observed("round.high"), 0.0);
  EXPECT_EQ(observed("round.constrained"), 1.0);
  EXPECT_EQ(observed("round.max_targets"), 1.0);
  EXPECT_EQ(observed("round.strike_threshold_mps"), 0.5);
  EXPECT_NEAR(observed("round.elapsed_s"), 1.0, kFloat);

  WhacAMoleRound free(R"({"condition": "high-unconstrained"})");
  free.idle();
  EXPECT_EQ(Observed(free)("round.high"), 1.0);
  EXPECT_EQ(Observed(free)("round.constrained"), 0.0);
  EXPECT_EQ(Observed(free)("round.strike_threshold_mps"), 0.0);
}

// The head is at (0, 1.2, 0), the mid area's origin at (0.15, 1.1, 0.4).
TEST(Privileged, Hammer) {
  WhacAMoleRound round(R"({"condition": "medium"})");
  round.frameWithMarker({0.1, 1.0, 0.3});
  round.frameWithMarker({0.1, 1.0, 0.31});
  const Observed observed(round);
  EXPECT_TRUE(observed.vector("hammer.", "_m").isApprox(Vec3(0.1, -0.2, 0.31), kFloat));
  EXPECT_TRUE(observed.vector("hammer.v", "_mps").isApprox(Vec3(0, 0, 0.2), 1e-4));
  EXPECT_TRUE(observed.vector("hammer.root_v", "_mps").isApprox(Vec3(0, 0, 0.1), 1e-4));
  EXPECT_NEAR(observed("hammer.strike_mps"), 0.1, 1e-4);
  EXPECT_NEAR(observed("hammer.depth_m"), -0.09, kFloat);
  EXPECT_TRUE(observed.vector("hammer.face_", "").isApprox(Vec3(-1, 0, 0), kFloat));
  EXPECT_TRUE(observed.vector("hammer.handle_", "").isApprox(Vec3(0, 1, 0), kFloat));
}

// Downwards strikes; the area at (0.15, 0.9, 0.35), its normal (0, -1, 1) / sqrt(2).
TEST(Privileged, HammerAtTheLowArea) {
  WhacAMoleRound round(R"({"condition": "low-easy"})");
  round.frameWithMarker({0.15, 1.0, 0.35});
  round.frameWithMarker({0.15, 0.98, 0.35});
  EXPECT_NEAR(Observed(round)("hammer.strike_mps"), 0.2, 1e-4);
  EXPECT_NEAR(Observed(round)("hammer.depth_m"), -0.08 * std::sqrt(0.5), kFloat);
}

TEST(Privileged, ATargetThroughItsLife) {
  WhacAMoleRound round(R"({"condition": "easy"})");
  round.idle();
  EXPECT_EQ(Observed(round).present(), 0);

  const Target& target = round.waitFor(Target::State::kFadeIn);
  const int number = target.cell();
  const std::string cell = "cell" + std::to_string(number) + ".";
  const Observed grows(round);
  EXPECT_EQ(grows.present(), 1);
  EXPECT_EQ(grows(cell + "alive"), 0.0);
  // Its life counts from the last fixed step, up to 2 ms before the frame.
  EXPECT_NEAR(grows(cell + "life_s"), 1.1, 2.1e-3);
  // The middle of the hit volume is 1 cm behind the plane.
  const Vec3 middle = Vec3(0.15, 1.1, 0.41) + cellCenter_m(number);
  const Vec3 marker = Vec3(0.0, 0.3, -0.5) + kHammerToMarker_m;
  EXPECT_TRUE(grows.vector(cell, "_m").isApprox(middle - marker, kFloat));
  for (const char* same : {"present", "alive", "overlap", "life_s", "x_m", "y_m", "z_m"}) {
    EXPECT_EQ(grows(std::string("next0.") + same), grows(cell + same)) << same;
    EXPECT_EQ(grows(std::string("nearest.") + same), grows(cell + same)) << same;
    EXPECT_EQ(grows(std::string("next1.") + same), 0.0) << same;
  }

  round.waitFor(Target::State::kAlive);
  EXPECT_EQ(Observed(round)(cell + "alive"), 1.0);
  EXPECT_LE(Observed(round)(cell + "life_s"), 1.0);
  EXPECT_EQ(Observed(round)(cell + "overlap"), 0.0);
  round.frameWithHead(round.hitCenter(target));
  EXPECT_EQ(Observed(round)(cell + "overlap"), 1.0);

  round.waitFor(Target::State::kFadeOut);
  EXPECT_EQ(Observed(round).present(), 0);
}

TEST(Privileged, NextAreOrderedByTheEndOfTheirLife) {
  WhacAMoleRound round(R"({"condition": "hard", "spawn_times": [0.09, 0.29, 0.49, 0.69],
                           "spawn_cells": [6, 0, 8, 4]})");
  round.idle(18);  // 0.85 s
  const Observed observed(round);
  EXPECT_EQ(observed.present(), 4);
  for (int i = 0; i < Privileged::kNext; ++i) {
    const std::string next = "next" + std::to_string(i) + ".";
    // Appeared 0.2 s after one another.
    EXPECT_NEAR(observed(next + "life_s"), 0.35 + 0.2 * i, 0.01);
    const Vec3 cell = cellCenter_m(std::vector<int>{6, 0, 8}[static_cast<std::size_t>(i)]);
    EXPECT_NEAR(observed(next + "x_m") - observed("next0.x_m"), cell.x() - cellCenter_m(6).x(),
                kFloat);
  }
  // The hammer hangs low at x = -0.05: the bottom left cell is the nearest.
  EXPECT_EQ(observed("nearest.x_m"), observed("cell6.x_m"));
  EXPECT_EQ(observed("nearest.y_m"), observed("cell6.y_m"));
}

// The user looks away, at it, and away again.
TEST(Privileged, OnlyWhatTheHeadsetHasShown) {
  WhacAMole game;
  testing::GameHarness round(game, 3, R"({"condition": "easy"})");
  const Pose hand{Vec3(0.2, 0.8, 0.0), Quat::Identity()};
  const Vec3 head(0.0, 1.2, 0.0);
  std::int64_t frames = 0;
  const auto play = [&](const Quat& looking) {
    round.frame(frames++ * WhacAMoleRound::kPeriod_ns, {{head, looking}, hand});
  };
  const Quat ahead = Quat::Identity();
  const Quat behind(0.0, 0.0, 1.0, 0.0);
  while (round.all<Target>().empty() || round.all<Target>()[0]->state() != Target::State::kAlive) {
    play(behind);
    ASSERT_LT(frames, 100);
  }
  EXPECT_EQ(Observed(round.env()).present(), 0);
  EXPECT_EQ(Observed(round.env())("nearest.present"), 0.0);
  EXPECT_EQ(Observed(round.env())("aid.progress_m"), 0.0);
  play(ahead);
  EXPECT_EQ(Observed(round.env()).present(), 1);
  play(behind);
  EXPECT_EQ(Observed(round.env()).present(), 1) << "it was seen";
  while (!round.all<Target>().empty()) play(behind);
  while (round.all<Target>().empty()) play(behind);
  EXPECT_EQ(Observed(round.env()).present(), 0) << "the next one was not";
}

TEST(Privileged, ProgressTowardsTheTargetThatExpiresFirst) {
  WhacAMoleRound round(
      R"({"condition": "hard", "spawn_times": [0.1, 0.4], "spawn_cells": [0, 8]})");
  round.idle(12);
  const Vec3 first = Vec3(0.15, 1.1, 0.41) + cellCenter_m(0);
  round.frameWithMarker(first + Vec3(0.0, 0.0, -0.20));
  const double before = Observed(round)("aid.progress_m");
  round.frameWithMarker(first + Vec3(0.0, 0.0, -0.15));
  EXPECT_NEAR(Observed(round)("aid.progress_m") - before, 0.05, kFloat);
  round.frameWithMarker(first + Vec3(0.0, 0.0, -0.30));
  EXPECT_NEAR(Observed(round)("aid.progress_m") - before, -0.10, kFloat);
}

// 5 cm in a frame from rest is 0.5 m/s after the filter; 15 cm away that counts exp(-(15 / 8)^2) =
// 0.029730, for 50 ms.
TEST(Privileged, StrikingNearATarget) {
  WhacAMoleRound round(R"({"condition": "hard", "spawn_times": [0.1], "spawn_cells": [0]})");
  const Vec3 first = Vec3(0.15, 1.1, 0.41) + cellCenter_m(0);
  for (int i = 0; i < 16; ++i) round.frameWithMarker(first + Vec3(0.0, 0.0, -0.20));
  const double before = Observed(round)("aid.strike");
  EXPECT_NEAR(before, 0.0, 1e-6);
  round.frameWithMarker(first + Vec3(0.0, 0.0, -0.15));
  EXPECT_NEAR(Observed(round)("aid.strike") - before, 0.5 * 0.029730 * 0.05, 1e-6);
  const double there = Observed(round)("aid.strike");
  round.frameWithMarker(first + Vec3(0.0, 0.0, -0.30));  // backwards
  EXPECT_EQ(Observed(round)("aid.strike"), there);
}

// A stroke begins 10 cm in front of a cell; cells are 12.5 cm apart.
TEST(Privileged, WhereAStrokeBegins) {
  WhacAMoleRound round("{}");
  round.frameWithMarker({0.15, 1.1, 0.30});
  EXPECT_EQ(Observed(round)("aid.start_cell"), 4.0);
  EXPECT_NEAR(Observed(round)("aid.start_distance_m"), 0.0, kFloat);
  round.frameWithMarker({0.15 - 0.125, 1.1 + 0.125 + 0.03, 0.26});
  EXPECT_EQ(Observed(round)("aid.start_cell"), 0.0);
  EXPECT_TRUE(
      Observed(round).vector("aid.home_", "_m").isApprox(Vec3(0.125, -0.155, 0.04), kFloat));
  EXPECT_NEAR(Observed(round)("aid.start_distance_m"), 0.05, kFloat);

  WhacAMoleRound low(R"({"condition": "low"})");
  const double half = std::sqrt(0.5);
  low.frameWithMarker(Vec3(0.15, 0.9, 0.35) - 0.10 * Vec3(0.0, -half, half));
  EXPECT_EQ(Observed(low)("aid.start_cell"), 4.0);
  EXPECT_NEAR(Observed(low)("aid.start_distance_m"), 0.0, 1e-6);
  EXPECT_NEAR(Observed(low).vector("aid.home_", "_m").norm(), 0.0, 1e-6);
}

TEST(Privileged, NothingIsLeftAfterTheRound) {
  WhacAMoleRound round(R"({"condition": "hard", "round_seconds": 1})");
  for (int i = 0; i < 40 && !round.harness.env().finished(); ++i) round.idle();
  ASSERT_TRUE(round.harness.env().finished());
  EXPECT_EQ(Observed(round).present(), 0);
}

// 7.5 cm in a frame from rest is judged as 0.75 m/s (target_test.cpp).
TEST(StrikeThreshold, IsAnOption) {
  for (const auto& [threshold, hits] : {std::pair{"0.7", 1}, std::pair{"0.8", 0}}) {
    WhacAMoleRound round(std::string(R"({"condition": "easy", "strike_threshold_mps": )") +
                         threshold + "}");
    const Target& target = round.waitFor(Target::State::kAlive);
    const Vec3 center = round.hitCenter(target);
    for (int i = 0; i < 16; ++i) round.frameWithHead(center - Vec3(0, 0, 0.075));
    for (int i = 0; i < 2; ++i) round.frameWithHead(center);
    EXPECT_EQ(round.round().counts().hits, hits) << threshold;
    EXPECT_EQ(round.round().counts().contacts, 1 - hits) << threshold;
  }
  EXPECT_EQ(Settings{}.playOptionsJson(), "{}");
  Settings easier;
  easier.strike_threshold_mps = 0.5F;
  EXPECT_EQ(easier.playOptionsJson(), R"({"strike_threshold_mps":0.5})");
}

}  // namespace
}  // namespace sim2vr::games::whacamole

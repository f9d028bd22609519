// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "own_folder.hpp"
#include "sim2vr/core/errors.hpp"
#include "whacamole_player.hpp"

namespace sim2vr::games::whacamole {
namespace {

std::string conditionJson(const std::string& condition, const std::string& more = "") {
  return R"({"condition": ")" + condition + "\"" + more + "}";
}

TEST(Round, PlacesTheAreaFromTheHeadPositionOfTheFirstFrame) {
  const double half = std::sqrt(0.5);
  const std::vector<std::tuple<std::string, Vec3, Vec3>> cases{
      {"medium", Vec3(0.15, -0.10, 0.40), Vec3(0, 0, 1)},
      {"low", Vec3(0.15, -0.30, 0.35), Vec3(0, -half, half)},
      {"high", Vec3(0.15, 0.20, 0.30), Vec3(0, half, half)}};
  for (const auto& [condition, offset, normal] : cases) {
    WhacAMoleRound round(conditionJson(condition));
    round.head = Vec3(0.1, 1.3, -0.2);
    round.idle();
    round.head = Vec3(5.0, 5.0, 5.0);
    round.idle(3);
    const auto& area = round.harness.scene().find("Target Area")->transform();
    EXPECT_LT((area.position() - (Vec3(0.1, 1.3, -0.2) + offset)).norm(), 1e-6) << condition;
    EXPECT_LT((area.forward() - normal).norm(), 1e-6) << condition;
  }
}

TEST(Round, SpawnsFromTheSecondFrameOnAtMostOnePerFrame) {
  WhacAMoleRound round(conditionJson("hard"));
  round.idle();
  EXPECT_EQ(round.round().phase(), Round::Phase::kPlay);
  EXPECT_TRUE(round.targets().empty());
  std::size_t last = 0;
  for (int i = 0; i < 200; ++i) {
    round.idle();
    const std::size_t now = round.targets().size();
    EXPECT_LE(now, last + 1);
    last = now;
    if (i == 0) {
      EXPECT_EQ(now, 1U);
    }
  }
}

TEST(Round, NeverExceedsTheMaximumAndReachesIt) {
  for (const auto& [condition, maximum] :
       std::vector<std::pair<std::string, std::size_t>>{{"easy", 1}, {"medium", 3}, {"hard", 5}}) {
    WhacAMoleRound round(conditionJson(condition), 4);
    std::size_t most = 0;
    int next_id = 0;
    for (int i = 0; i < 400; ++i) {
      round.idle();
      std::set<int> cells;
      for (const Target* target : round.targets()) {
        EXPECT_TRUE(cells.insert(target->cell()).second) << "two targets in one cell";
        EXPECT_LE(target->id(), next_id);
        next_id = std::max(next_id, target->id() + 1);
      }
      most = std::max(most, round.targets().size());
    }
    EXPECT_EQ(most, maximum) << condition;
  }
}

TEST(Round, ScheduledSpawnsComeInTheirFramesAndCells) {
  WhacAMoleRound round(R"({"condition": "easy", "spawn_times": [0.1, 0.12, 0.2],
                           "spawn_cells": [8, 8, 0]})");
  std::vector<std::size_t> counts;
  for (int n = 0; n < 6; ++n) {
    round.idle();
    counts.push_back(round.targets().size());
  }
  // Frame n lies just before 0.05 n s: 0.1 s is frame 3, 0.12 s frame 3 as well but one a frame.
  EXPECT_EQ(counts, (std::vector<std::size_t>{0, 0, 0, 1, 2, 3}));
  std::vector<int> cells;
  for (const Target* target : round.targets()) cells.push_back(target->cell());
  EXPECT_EQ(cells, (std::vector<int>{8, 8, 0}));
}

TEST(Round, ScheduleMustBeWhole) {
  const auto errorOf = [](const std::string& options) -> std::string {
    try {
      const WhacAMoleRound round(options);
    } catch (const InvalidArgument& error) {
      return error.what();
    }
    return "none";
  };
  EXPECT_EQ(errorOf(R"({"spawn_times": [1, 2], "spawn_cells": [1]})"),
            "option 'spawn_cells': got 1 cells, expected 2, one for each of spawn_times");
  EXPECT_EQ(errorOf(R"({"spawn_times": [2, 1], "spawn_cells": [1, 1]})"),
            "option 'spawn_times': got times out of order, expected ascending times");
  EXPECT_EQ(errorOf(R"({"spawn_times": [1], "spawn_cells": [1.5]})"),
            "option 'spawn_cells': got 1.500000, expected whole numbers");
}

TEST(Round, WaitsForTheCountdown) {
  WhacAMoleRound round(conditionJson("easy", R"(, "countdown_seconds": 1)"));
  round.idle(20);  // to t = 0.95
  EXPECT_EQ(round.round().phase(), Round::Phase::kCountdown);
  round.idle(2);  // t = 1.05 is the first frame with 1 s since placing
  EXPECT_EQ(round.round().phase(), Round::Phase::kPlay);
  EXPECT_TRUE(round.targets().empty());
  EXPECT_EQ(round.harness.env().timeFeature(), -1.0F);
  round.idle();
  EXPECT_EQ(round.targets().size(), 1U);
}

TEST(Round, EndsInTheFirstFrameAfterSixtySeconds) {
  WhacAMoleRound round(conditionJson("medium"), 1, testing::referenceTime(), nullptr, 50'000'000);
  round.idle(601);
  EXPECT_FLOAT_EQ(round.harness.env().timeFeature(), 0.0F);  // t = 30
  round.idle(600);                                           // t = 60 is not beyond 60
  EXPECT_FALSE(round.harness.env().finished());
  EXPECT_FLOAT_EQ(round.harness.env().timeFeature(), 1.0F);
  const Counts before = round.round().counts();
  round.idle();  // t = 60.05
  EXPECT_TRUE(round.harness.env().finished());
  EXPECT_TRUE(round.targets().empty());
  EXPECT_EQ(round.round().counts().misses, before.misses);
  round.idle(10);
  EXPECT_TRUE(round.harness.env().finished());
  EXPECT_TRUE(round.targets().empty());
}

TEST(Round, ShorterRoundsEndEarlierAndScaleTheTimeFeature) {
  WhacAMoleRound round(conditionJson("medium", R"(, "round_seconds": 2)"));
  round.idle(21);
  EXPECT_NEAR(round.harness.env().timeFeature(), 0.0F, 1e-5F);
  while (!round.harness.env().finished()) round.idle();
  EXPECT_EQ(round.frames(), 42);
}

TEST(Round, ThresholdLiesAtEightTenthsForEachPlacement) {
  const auto hits = [](const std::string& condition, const Vec3& velocity) {
    WhacAMoleRound round(conditionJson(condition));
    return round.round().isHit(velocity);
  };
  for (const char* condition : {"medium", "high", "easy", "hard"}) {
    EXPECT_FALSE(hits(condition, Vec3(0, -3, 0.8))) << condition;
    EXPECT_TRUE(hits(condition, Vec3(0, 0, 0.8001))) << condition;
    EXPECT_FALSE(hits(condition, Vec3(0, 0, -2))) << condition;
  }
  EXPECT_FALSE(hits("low", Vec3(0, -0.8, 3)));
  EXPECT_TRUE(hits("low", Vec3(0, -0.8001, 0)));
  EXPECT_FALSE(hits("low", Vec3(0, 2, 0)));
  EXPECT_TRUE(hits("low-unconstrained", Vec3(0, 2, 0)));
}

TEST(Round, ScriptedPlayerScoresInEveryPlacementAndAnIdleOneDoesNot) {
  for (const char* condition : {"medium", "low", "high", "hard"}) {
    WhacAMoleRound played(conditionJson(condition, R"(, "round_seconds": 15)"));
    ScriptedPlayer player;
    while (!played.harness.env().finished()) player.frame(played);
    EXPECT_GT(played.round().counts().hits, 10) << condition;
    WhacAMoleRound idled(conditionJson(condition, R"(, "round_seconds": 15)"));
    while (!idled.harness.env().finished()) idled.idle();
    EXPECT_EQ(idled.round().counts().hits, 0) << condition;
    EXPECT_GT(idled.round().counts().misses, 10) << condition;
  }
}

TEST(Round, FailRatesReachTheNextRoundsSpawner) {
  WhacAMole game;
  {
    testing::GameHarness first(game, 1, R"({"condition": "hard", "adaptive": true})");
    first.idle(400, {{Vec3(0, 1.2, 0), Quat::Identity()}, {Vec3::Zero(), Quat::Identity()}});
    EXPECT_GT(first.log("Misses"), 10);
  }
  Archive saved = Archive::saver();
  game.fields(saved);
  WhacAMole copy;
  Archive loader = Archive::loader(saved.bytes());
  copy.fields(loader);
  EXPECT_NO_THROW(loader.expectEnd());
  testing::GameHarness adaptive(game, 9, R"({"condition": "hard", "adaptive": true})");
  testing::GameHarness again(copy, 9, R"({"condition": "hard", "adaptive": true})");
  EXPECT_EQ(adaptive.save(), again.save());
  WhacAMole fresh;
  testing::GameHarness plain(fresh, 9, R"({"condition": "hard", "adaptive": true})");
  EXPECT_NE(adaptive.save(), plain.save());
}

class RoundLogTest : public ::testing::Test {
 protected:
  std::vector<std::string> lines(const std::string& path) const {
    std::ifstream file(root_ / path);
    std::vector<std::string> all;
    for (std::string line; std::getline(file, line);) all.push_back(line);
    return all;
  }

  const sim2vr::testing::OwnFolder folder_;
  const std::filesystem::path root_ = folder_.path();
};

TEST_F(RoundLogTest, WritesStatesAndEvents) {
  rl::EpisodeLogger logger(root_);
  WhacAMoleRound round(R"({"condition": "easy", "round_seconds": 2})", 13259,
                       testing::referenceTime(), &logger);
  while (!round.harness.env().finished()) round.idle();
  const auto states = lines("0000-easy/states.csv");
  ASSERT_EQ(states.size(), 2U + 42U);  // title, header, a row per frame
  EXPECT_EQ(states[0], "condition easy, random seed 13259");
  EXPECT_EQ(states[2].rfind("0, 0, 0, 0, 0, 0, 0, 1, ", 0), 0U)
      << states[2];  // left controller off
  EXPECT_EQ(states[3].rfind("0.049999997, ", 0), 0U) << states[3];
  const auto events = lines("0000-easy/events.csv");
  ASSERT_GE(events.size(), 6U);
  EXPECT_EQ(events[0], R"(0, game options {"round_seconds":2.0})");
  EXPECT_EQ(events[1], "0, target plane transform 0.15 1.1 0.4 0 0 0 1");
  EXPECT_EQ(
      events[2].rfind("0, grid mapping [0 0 0 -0.125 0.125 0.025 1.225 0.4] [1 0 1 0 0.125", 0), 0U)
      << events[2];
  EXPECT_EQ(events[3].rfind("0.049999997, target_spawn, target ID 0, grid ID ", 0), 0U)
      << events[3];
  EXPECT_NE(events[4].find(", target_miss, target ID 0, grid ID "), std::string::npos) << events[4];
  EXPECT_NE(events.back().find("episode statistics, contacts 0, hits 0, misses 1, hit rate 0"),
            std::string::npos)
      << events.back();
}

}  // namespace
}  // namespace sim2vr::games::whacamole

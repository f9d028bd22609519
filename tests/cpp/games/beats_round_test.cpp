// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "beats_player.hpp"
#include "own_folder.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/rl/episode_logger.hpp"

namespace sim2vr::games::beats {
namespace {

// In the middle of the lane's right half, cut downwards with the right hand: at (0.2, 0.9), from y
// = 0.725 to 1.075, touched by a blade's middle from 0.71 to 1.09. In the cut plane (0.8) at 1 s.
Level oneBox(CutDirection cut = CutDirection::kDown, double time_s = 1.0) {
  Level level = emptyLevel();
  level.boxes = {{time_s, 2.0, 1.0, Hand::kRight, cut}};
  return level;
}

Stance rightAt(const Vec3& place) {
  Stance stance;
  stance.right.position = place;
  return stance;
}

// 13.75 cm in a frame are 2.75 m/s; 30 degrees off: 50 + 37.5 + 37.5.
TEST(BeatsRound, ASliceIsWorthItsSpeedAndAngle) {
  BeatsRound round(oneBox());
  round.waitUntil(0.9);
  const Vec3 from(0.2, 1.15, 0.0);
  const Vec3 way = 0.1375 * Vec3(0.5, -std::numbers::sqrt3 / 2.0, 0.0);
  round.stroke(Hand::kRight, from, from + way);
  EXPECT_EQ(round.tally().slices(), 1);
  EXPECT_EQ(round.tally().score(), 125);
  EXPECT_NEAR(round.tally().meanSpeed_mps(), 2.75, 1e-4);
  EXPECT_NEAR(round.tally().meanAngle_deg(), 30.0, 1e-4);
  EXPECT_EQ(round.harness.env().reward(), 125.0F) << "in the frame whose pose made the cut";
  round.frame({});
  EXPECT_EQ(round.harness.env().reward(), 0.0F);
  EXPECT_EQ(round.rewardSum(), 125.0);
  EXPECT_EQ(round.harness.log("AccumulatedCorrectSlices"), 1.0);
  EXPECT_EQ(round.harness.log("BoxesNotSliced"), 0.0);
  EXPECT_TRUE(round.round().boxesOut().empty());
}

TEST(BeatsRound, WrongHandAndWrongDirectionAreErrorsAndTakeTheBox) {
  BeatsRound left(oneBox());
  left.waitUntil(0.9);
  left.stroke(Hand::kLeft, {0.2, 1.15, 0.0}, {0.2, 0.95, 0.0});
  EXPECT_EQ(left.tally().count(Fault::kWrongHand), 1);
  BeatsRound up(oneBox());
  up.waitUntil(0.9);
  up.stroke(Hand::kRight, {0.2, 0.65, 0.0}, {0.2, 0.85, 0.0});
  EXPECT_EQ(up.tally().count(Fault::kWrongDirection), 1);
  for (BeatsRound* round : {&left, &up}) {
    round->waitUntil(2.0);
    EXPECT_EQ(round->tally().errors(), 1.0);
    EXPECT_EQ(round->tally().score(), 0);
    EXPECT_EQ(round->tally().misses(), 0);
    EXPECT_FALSE(round->harness.env().finished());
  }
}

// The box (at 1 s) is there from the start, the mine (at 3 s) comes 2 s before its time, the wall
// (at 9 s) never. The stroke of the first test touches the box's top, at y = 1.09, half-way through
// its frame from 0.95 to 1 s: (1.15 - 1.09) / (0.1375 cos 30 degrees) = 0.504, 25 ms early.
TEST(BeatsRound, TheLogHasWhatCameAndHowItEnded) {
  const sim2vr::testing::OwnFolder root;
  Level level = oneBox();
  level.mines = {{3.0, 0.0, 2.0}};
  level.walls = {{9.0, 1.5, 3.0, 0.0}};
  level.length_s = 5.0;
  {
    rl::EpisodeLogger logger(root.path());
    BeatsRound round(level, R"({"end_on_miss": false})", 49'999'997, &logger);
    round.waitUntil(0.9);
    const Vec3 from(0.2, 1.15, 0.0);
    const Vec3 way = 0.1375 * Vec3(0.5, -std::numbers::sqrt3 / 2.0, 0.0);
    round.stroke(Hand::kRight, from, from + way);
    round.waitUntil(5.1);
  }
  std::ifstream file(root / "0000-by hand" / "events.csv");
  std::vector<std::string> lines;
  for (std::string line; std::getline(file, line);) lines.push_back(line);
  ASSERT_EQ(lines.size(), 7U);
  EXPECT_EQ(lines[2],
            "0, box_spawn, number 0, due 1, column 2, row 1, kind: right box, direction -90");
  EXPECT_EQ(lines[3].find("0.99999994, box_slice, number 0, level time 0.97"), 0U) << lines[3];
  const auto behind = [&lines](const std::string& field) {
    return std::stod(lines[3].substr(lines[3].find(field) + field.size()));
  };
  EXPECT_NEAR(behind(", timing "), 0.0252 - 0.05, 1e-3);
  EXPECT_NEAR(behind(", angle "), 30.0, 1e-3);
  EXPECT_EQ(lines[4], "1.05, mine_spawn, number 0, due 3, column 0, row 2");
  EXPECT_NE(lines[5].find(", mine_avoided, number 0, level time 3.4"), std::string::npos)
      << lines[5];
  EXPECT_NE(lines[6].find("episode statistics"), std::string::npos);
}

// Just inside and just outside of 60 degrees, to either side.
TEST(BeatsRound, SixtyDegreesAreTheLimit) {
  for (const double side : {-1.0, 1.0}) {
    for (const double degrees : {59.9, 60.1}) {
      BeatsRound round(oneBox());
      round.waitUntil(0.9);
      const double angle = degrees * std::numbers::pi / 180.0;
      const Vec3 from(0.2, 1.12, 0.0);
      round.stroke(Hand::kRight, from,
                   from + 0.25 * Vec3(side * std::sin(angle), -std::cos(angle), 0.0));
      EXPECT_EQ(round.tally().slices(), degrees < 60.0 ? 1 : 0) << side << " " << degrees;
      EXPECT_EQ(round.tally().count(Fault::kWrongDirection), degrees < 60.0 ? 0 : 1);
    }
  }
}

TEST(BeatsRound, AnyDirectionMayBeCutAnyWay) {
  for (const Vec3& way : {Vec3(0.0, 0.3, 0.0), Vec3(-0.3, 0.1, 0.0), Vec3(0.2, -0.2, 0.0)}) {
    BeatsRound round(oneBox(CutDirection::kAny));
    round.waitUntil(0.9);
    const Vec3 middle(0.2, 0.9, 0.0);
    round.stroke(Hand::kRight, middle - 4.0 * way, middle);
    EXPECT_EQ(round.tally().slices(), 1);
    EXPECT_EQ(round.tally().score(), 200);
  }
}

// 0.4 m/s are no cut; the same blade is one as soon as it is fast, from inside the box.
TEST(BeatsRound, ASlowBladeDoesNotCut) {
  BeatsRound round(oneBox());
  round.waitUntil(0.8);
  round.frame(rightAt({0.2, 1.2, 0.0}));
  round.frame(rightAt({0.2, 1.095, 0.0}));
  round.frame(rightAt({0.2, 1.075, 0.0}));
  round.frame(rightAt({0.2, 1.055, 0.0}));
  EXPECT_EQ(round.tally().slices(), 0);
  EXPECT_EQ(round.tally().errors(), 0.0);
  round.frame(rightAt({0.2, 0.905, 0.0}));
  EXPECT_EQ(round.tally().slices(), 1);
  EXPECT_EQ(round.tally().score(), 167);  // 3 m/s straight: 50 + 41.67 + 75
}

// A blade held into the box's way is not moved, whatever the box does: it is missed.
TEST(BeatsRound, AStillBladeCutsNothing) {
  BeatsRound round(oneBox());
  const Stance still = rightAt({0.2, 0.9, 0.0});
  round.waitUntil(2.0, still);
  EXPECT_EQ(round.tally().slices(), 0);
  EXPECT_EQ(round.tally().misses(), 1);
}

// Along itself a blade does not cut; upright and thrust forwards it has no direction.
TEST(BeatsRound, AStabIsNoCut) {
  BeatsRound along(oneBox());
  along.waitUntil(0.9);
  along.stroke(Hand::kRight, {0.2, 0.9, -1.5}, {0.2, 0.9, 0.0});
  EXPECT_EQ(along.tally().slices() + along.tally().errors(), 0.0);
  BeatsRound upright(oneBox());
  upright.waitUntil(0.9);
  const Quat up(Eigen::AngleAxisd(-std::numbers::pi / 2.0, Vec3::UnitX()));
  for (const double z : {0.3, 0.9}) {
    Stance stance = rightAt({0.2, 0.2, z});
    stance.right.rotation = up;
    upright.frame(stance);
  }
  EXPECT_EQ(upright.tally().count(Fault::kWrongDirection), 1);
}

// The centre is in the head plane 0.8 m / 2 m/s = 0.4 s after its time: at 1.38 s. Frame 28 lies at
// 1.4 s.
TEST(BeatsRound, AMissIsWhenTheBoxPassesTheHead) {
  BeatsRound round(oneBox(CutDirection::kDown, 0.98));
  round.waitUntil(1.35);
  EXPECT_EQ(round.tally().misses(), 0);
  EXPECT_NEAR(round.round().box(0).center_m.z(), 0.8 + 2.0 * (0.98 - 1.35), 1e-6);
  round.frame({});
  EXPECT_EQ(round.tally().misses(), 1);
  EXPECT_EQ(round.tally().errors(), 0.0);
  EXPECT_FALSE(round.harness.env().finished());
}

TEST(BeatsRound, BoxesAppearInTimeAndComeAtTheLevelsSpeed) {
  Level level = oneBox(CutDirection::kDown, 2.98);
  BeatsRound round(level);
  round.waitUntil(0.95);
  EXPECT_TRUE(round.round().boxesOut().empty());
  round.frame({});
  ASSERT_EQ(round.round().boxesOut(), std::vector<std::size_t>{0});
  // At t = 1: 0.8 + 2 * 1.98.
  EXPECT_TRUE(round.round().box(0).center_m.isApprox(Vec3(0.2, 0.9, 4.76), 1e-6));
  round.waitUntil(2.0);
  EXPECT_TRUE(round.round().box(0).center_m.isApprox(Vec3(0.2, 0.9, 2.76), 1e-6));
}

TEST(BeatsRound, ItsEndIsTheLevels) {
  Level level = emptyLevel(1.0);
  BeatsRound round(level);
  for (int n = 0; n < 20; ++n) round.frame({});
  EXPECT_FALSE(round.harness.env().finished());
  round.frame({});
  EXPECT_TRUE(round.harness.env().finished()) << "20 steps at 20 Hz";
}

TEST(BeatsRound, LeadInPutsItOff) {
  BeatsRound round(oneBox(CutDirection::kDown, 0.98),
                   R"({"end_on_miss": true, "lead_in_seconds": 1.5})");
  EXPECT_NEAR(round.round().time_s(), -1.5, 1e-9);
  round.waitUntil(2.85);
  EXPECT_EQ(round.tally().misses(), 0);
  EXPECT_FALSE(round.harness.env().finished());
  round.frame({});
  EXPECT_EQ(round.tally().misses(), 1);
  EXPECT_TRUE(round.harness.env().finished());
}

TEST(BeatsRound, EnergyEndsItToo) {
  Level level = emptyLevel();
  for (int i = 0; i < 6; ++i) {
    level.boxes.push_back({0.98 + i, 2.0, 1.0, Hand::kRight, CutDirection::kAny});
  }
  BeatsRound round(level, R"({"end_on_miss": false, "energy": true})");
  // 0.5 - 4 * 0.15 < 0.
  round.waitUntil(4.35);
  EXPECT_EQ(round.tally().misses(), 3);
  EXPECT_NEAR(round.harness.log("Energy"), 0.05, 1e-12);
  round.frame({});
  EXPECT_TRUE(round.harness.env().finished());
}

// Two boxes of one frame: the points of the second count double after two slices.
TEST(BeatsRound, MultiplierIsAnOption) {
  Level level = emptyLevel();
  for (int i = 0; i < 3; ++i) {
    level.boxes.push_back(
        {1.0, 2.0, static_cast<double>(2 - i), Hand::kRight, CutDirection::kDown});
  }
  for (const bool multiply : {false, true}) {
    BeatsRound round(level, multiply ? R"({"end_on_miss": false, "multiplier": true})"
                                     : R"({"end_on_miss": false})");
    round.waitUntil(0.9);
    round.stroke(Hand::kRight, {0.2, 1.7, 0.0}, {0.2, 0.3, 0.0});
    EXPECT_EQ(round.tally().slices(), 3);
    EXPECT_EQ(round.tally().score(), multiply ? 800 : 600);
    EXPECT_EQ(round.tally().longestCombo(), 3);
  }
}

// The blade's tip is at z = 1.08 + 0.015, the mine of 0.12 m comes along its line: 0.8 + 2 (1 - t)
// - 0.12 = 1.095 at t = 0.7925.
TEST(BeatsRound, MinesAreTouchedByStillBlades) {
  Level level = emptyLevel();
  level.mines = {{1.0, 2.0, 1.0}, {1.0, 0.0, 0.0}};
  BeatsRound round(level);
  const Stance still = rightAt({0.2, 0.9, 0.0});
  round.waitUntil(0.75, still);
  EXPECT_EQ(round.tally().errors(), 0.0);
  round.frame(still);
  EXPECT_EQ(round.tally().count(Fault::kMine), 1);
  round.waitUntil(2.0, still);
  EXPECT_EQ(round.tally().errors(), 1.0);
  EXPECT_EQ(round.tally().minesAvoided(), 1);
}

// A wall over the left half, from x = -0.8 to 0, 1 m deep: its front is 0.08 m before the head at t
// = 0.96 s, its back as far behind at 1.54 s.
Level leftWall() {
  Level level = emptyLevel();
  level.walls = {{1.0, 0.5, 0.0, 0.0, 2.0, 3.0}};
  return level;
}

TEST(BeatsRound, AWallIsMetOnceAndMeasured) {
  BeatsRound round(leftWall());
  round.waitUntil(0.95);
  EXPECT_EQ(round.tally().errors(), 0.0);
  round.frame({});
  EXPECT_EQ(round.tally().count(Fault::kWall), 1);
  round.waitUntil(3.0);
  EXPECT_EQ(round.tally().count(Fault::kWall), 1);
  EXPECT_EQ(round.tally().errors(), 1.0);
  // Frames from 1.0 to 1.5 s.
  EXPECT_NEAR(round.tally().wall_s(), 11 * 0.05, 1e-6);
  EXPECT_EQ(round.tally().wallsAvoided(), 0);
  BeatsRound strict(leftWall(), R"({"end_on_miss": false, "wall_errors_per_second": 10.0})");
  strict.waitUntil(3.0);
  EXPECT_NEAR(strict.tally().errors(), 1.0 + 5.5, 1e-5);
}

TEST(BeatsRound, AHeadAsideOrBelowAvoidsWalls) {
  Level level = leftWall();
  // From row 2 on: its lower edge is 0.125 m below where the head started.
  level.walls.push_back({3.0, 0.25, 0.0, 2.0, 4.0, 2.0});
  for (const double margin_m : {-0.01, 0.01}) {
    BeatsRound round(level);
    round.frame({});
    Stance aside, below;
    aside.head = {0.08 + margin_m, 1.2, 0.0};
    below.head = {0.0, 1.2 - 0.205 - margin_m, 0.0};
    round.waitUntil(2.0, aside);
    round.waitUntil(4.5, below);
    EXPECT_EQ(round.tally().count(Fault::kWall), margin_m < 0.0 ? 2 : 0);
    EXPECT_EQ(round.tally().wallsAvoided(), margin_m < 0.0 ? 0 : 2);
  }
}

// The same motion, seen 2 to 90 times a second: 4 m/s downwards through the box, and a swing around
// the hand with 4 rad/s.
TEST(BeatsRound, CutsAreTheSameAtTwoToNinetyPosesASecond) {
  for (const bool swing : {false, true}) {
    std::vector<int> scores;
    for (const int rate_hz : {2, 5, 20, 90}) {
      const std::int64_t period_ns = 1'000'000'000 / rate_hz;
      BeatsRound round(oneBox(), R"({"end_on_miss": false})", period_ns);
      while (round.round().time_s() < 1.9) {
        const double t_s = static_cast<double>(round.frames() * period_ns) * 1e-9;
        const double since_s = std::clamp(t_s, 0.5, 1.5) - 1.0;
        Stance stance;
        if (swing) {
          stance.right = {{0.2, 0.9, 0.0}, Quat(Eigen::AngleAxisd(4.0 * since_s, Vec3::UnitX()))};
        } else {
          stance.right.position = {0.2, 0.9 - 4.0 * since_s, 0.0};
        }
        round.frame(stance);
      }
      EXPECT_EQ(round.tally().slices(), 1) << rate_hz;
      EXPECT_EQ(round.tally().misses() + round.tally().errors(), 0.0) << rate_hz;
      scores.push_back(round.tally().score());
    }
    // 50 + 75 * 3.5 / 4.5 + 75 for the straight one.
    if (!swing) {
      EXPECT_EQ(scores.front(), 183);
    }
    for (const int score : scores) EXPECT_NEAR(score, scores.front(), 1);
  }
}

TEST(BeatsRound, AHandWithoutAControllerHasNoSaber) {
  Level level = oneBox();
  level.mines = {{1.0, 1.0, 1.0}};
  BeatsRound round(level);
  Stance stance = rightAt({0.2, 0.9, 0.0});
  stance.left.position = {-0.2, 0.9, 0.0};
  stance.left_on = false;
  round.waitUntil(0.95, stance);
  stance.right_on = false;
  round.frame(stance);
  // Comes on again elsewhere: from nowhere, not by a stroke.
  stance.right_on = true;
  stance.right.position = {0.2, 0.3, 0.0};
  round.waitUntil(3.0, stance);
  EXPECT_EQ(round.tally().errors(), 0.0);
  EXPECT_EQ(round.tally().slices(), 0);
  EXPECT_EQ(round.tally().misses(), 1);
}

TEST(BeatsRound, CutsAndErrorsAreFeltAndHeard) {
  Level level = oneBox();
  level.mines = {{2.5, 0.0, 0.0}};
  level.walls = {{3.5, 0.1, 0.0, 0.0, 4.0, 4.0}};
  BeatsRound round(level);
  const auto names = [&round] {
    std::vector<std::string> heard;
    for (const rl::SoundEvent& sound : round.harness.sounds().take()) heard.push_back(sound.name);
    return heard;
  };
  round.waitUntil(0.9);
  round.stroke(Hand::kRight, {0.2, 1.5, 0.0}, {0.2, 0.9, 0.0});
  EXPECT_EQ(names(), std::vector<std::string>{"cut"});
  auto pulses = round.harness.session().takePulses();
  ASSERT_EQ(pulses.size(), 1);
  EXPECT_EQ(pulses[0].hand, xr::Hand::right);
  EXPECT_EQ(pulses[0].duration_ns, 20'000'000);
  EXPECT_EQ(pulses[0].amplitude, 0.5F);
  Stance in_the_way;
  in_the_way.left.position = {-0.6, 0.55, 0.0};
  round.waitUntil(3.0, in_the_way);
  EXPECT_EQ(names(), std::vector<std::string>{"mine"});
  pulses = round.harness.session().takePulses();
  ASSERT_EQ(pulses.size(), 1);
  EXPECT_EQ(pulses[0].hand, xr::Hand::left);
  EXPECT_EQ(pulses[0].amplitude, 1.0F);
  round.waitUntil(5.0, in_the_way);
  EXPECT_EQ(names(), std::vector<std::string>{"wall"});
  EXPECT_EQ(round.harness.session().takePulses().size(), 2);
}

TEST(BeatsRound, GoesOnFromASavedStateToTheBit) {
  Level level = oneBox();
  level.mines = {{2.0, 1.0, 0.0}};
  level.walls = {{1.5, 0.5, 0.0, 0.0, 2.0, 3.0}};
  const auto play = [](BeatsRound& round, int first, int count) {
    for (int n = first; n < first + count; ++n) {
      Stance stance = rightAt({0.2, 0.9 + 0.3 * std::sin(1.1 * n), 0.0});
      stance.left.position = {-0.2, 0.6, 0.0};
      stance.head.x() = 0.1 * std::sin(0.3 * n);
      round.frame(stance);
    }
  };
  BeatsRound one(level);
  play(one, 0, 22);
  const std::string saved = one.harness.save();
  play(one, 22, 40);
  BeatsRound two(level);
  play(two, 0, 22);
  two.harness.load(saved);
  EXPECT_EQ(two.harness.save(), saved);
  play(two, 22, 40);
  EXPECT_EQ(two.harness.save(), one.harness.save());
  EXPECT_GT(one.tally().slices() + one.tally().errors(), 1.0) << "something has to happen";

  level.hash = "fedcba9876543210";
  BeatsRound other(level);
  try {
    other.harness.load(saved);
    FAIL() << "a round of another level was taken";
  } catch (const EngineError& error) {
    EXPECT_NE(std::string(error.what()).find("0123456789abcdef"), std::string::npos);
  }
}

TEST(BeatsState, WithACraftedNumberIsRefusedByTheField) {
  BeatsRound round(emptyLevel());
  round.frame({});
  const auto errorWith = [&](const std::string& field, const auto& value) -> std::string {
    std::string state = round.harness.save();
    const std::string tag = static_cast<char>(field.size()) + field;
    const std::size_t place = state.find(tag);
    EXPECT_NE(place, std::string::npos) << field;
    std::memcpy(state.data() + place + tag.size(), &value, sizeof(value));
    try {
      BeatsRound(emptyLevel()).harness.load(state);
    } catch (const EngineError& error) {
      return error.what();
    }
    return "accepted";
  };
  for (const std::string field : {"score", "slices", "mines_avoided", "combo", "longest_combo"}) {
    EXPECT_EQ(errorWith(field, std::numeric_limits<int>::max()),
              "saved state: field '" + field + "': got 2147483647, expected 0 to 1000000000");
  }
  EXPECT_EQ(errorWith("energy", std::nan("")),
            "saved state: field 'energy': got nan, expected 0 to 1");
  EXPECT_EQ(errorWith("tier", 40), "saved state: field 'tier': got 40, expected 0 to 3");
}

}  // namespace
}  // namespace sim2vr::games::beats

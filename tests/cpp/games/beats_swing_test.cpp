// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "beats/level.hpp"
#include "beats/settings.hpp"
#include "beats/swing.hpp"
#include "beats_player.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180.0;

Settings settingsOf(const std::string& json) {
  Options options = Options::fromJson(json);
  Settings settings = Settings::fromOptions(options);
  options.expectAllRead();
  return settings;
}

// A blade of 1 m about a hand at the origin, in the plane x = aside: upwards at 90 degrees, away
// from the player at 0.
Segment bladeAt(double degrees, double aside_m = 0.0) {
  const Vec3 hand(aside_m, 0.0, 0.0);
  return {hand, hand + Vec3(0.0, std::sin(degrees * kDegree), std::cos(degrees * kDegree))};
}

// 70 + 30 + 15; half of each is 35 + 15 + 7.5, rounded up.
TEST(BeatsSwing, PointsAreSwingAndCentre) {
  EXPECT_EQ(swingPoints(1.0, 1.0, 0.0), 115);
  EXPECT_EQ(swingPoints(2.0, 1.5, 0.3), 100);
  EXPECT_EQ(swingPoints(0.5, 0.5, 0.15), 35 + 15 + 8);
  EXPECT_EQ(swingPoints(0.0, 0.0, 1.0), 0);
}

TEST(BeatsSwing, StepsOutOfThePlaneCountLess) {
  EXPECT_EQ(countedAngle_deg(10.0, 75.0), 10.0);
  EXPECT_EQ(countedAngle_deg(10.0, 82.5), 5.0);
  EXPECT_EQ(countedAngle_deg(10.0, 90.0), 0.0);
}

// Down from 90 degrees by 10 a frame: the 8 steps before the cut at 10 degrees are 80 degrees.
TEST(BeatsSwing, TheWayBeforeTheCutCountsWhileItGoesOneWay) {
  Swing swing;
  for (int i = 0; i <= 8; ++i) swing.add(0.01 * i, bladeAt(90.0 - 10.0 * i));
  EXPECT_NEAR(swing.before(), 0.8, 1e-9);
  EXPECT_NEAR(swing.before(4.0), 0.74, 1e-9) << "4 degrees of the latest step";
  // Drawn back before: those steps do not count.
  Swing back;
  for (int i = 0; i <= 4; ++i) back.add(0.01 * i, bladeAt(50.0 + 10.0 * i));
  for (int i = 1; i <= 3; ++i) back.add(0.04 + 0.01 * i, bladeAt(90.0 - 10.0 * i));
  EXPECT_NEAR(back.before(), 0.3, 1e-9);
  // 0.4 s of steps of 0.1 s: 4, and the one in which the time is up.
  Swing slow;
  for (int i = 0; i <= 8; ++i) slow.add(0.1 * i, bladeAt(90.0 - 10.0 * i));
  EXPECT_NEAR(slow.before(), 0.5, 1e-9);
}

// Cut at 20 degrees, the box's middle ahead of the hand and 6 cm aside of the swing's plane. The
// tip is level between 5 and -5 degrees: of that step half counts before and half after.
TEST(BeatsSwing, TheWayBehindTheMiddleCountsAfterTheCut) {
  Swing swing;
  double degrees = 95.0, time_s = 0.0;
  const auto step = [&] { swing.add(time_s += 0.01, bladeAt(degrees -= 10.0, 0.06)); };
  while (degrees > 25.1) step();
  step();
  OpenCut cut = OpenCut::of(swing, {0.0, 0.0, 0.8});
  EXPECT_NEAR(cut.centre_distance_m, 0.06, 1e-9);
  EXPECT_NEAR(cut.before, 0.7, 1e-9);  // from 85 to 15
  EXPECT_FALSE(cut.follow(swing));
  step();
  EXPECT_FALSE(cut.follow(swing));
  EXPECT_FALSE(cut.halved);
  step();
  EXPECT_FALSE(cut.follow(swing));
  EXPECT_TRUE(cut.halved);
  EXPECT_NEAR(cut.before, 0.85, 1e-9);
  EXPECT_NEAR(cut.after, 5.0 / 60.0, 1e-9);
  for (int i = 0; i < 5; ++i) {
    step();
    EXPECT_FALSE(cut.follow(swing));
  }
  step();
  EXPECT_TRUE(cut.follow(swing)) << "65 degrees are enough";
  // 59.5 + 30 + 12: 70 * 0.85 rounds up.
  EXPECT_EQ(cut.points(), 60 + 30 + 12);
}

TEST(BeatsSwing, ASwingEndsWhereItTurnsBack) {
  Swing swing;
  for (int i = 0; i <= 9; ++i) swing.add(0.01 * i, bladeAt(85.0 - 10.0 * i));
  OpenCut cut = OpenCut::of(swing, {0.0, 0.0, 0.8});
  EXPECT_FALSE(cut.follow(swing));
  swing.add(0.10, bladeAt(-15.0));
  EXPECT_FALSE(cut.follow(swing));
  swing.add(0.11, bladeAt(-5.0));
  EXPECT_TRUE(cut.follow(swing));
  EXPECT_NEAR(cut.after, 15.0 / 60.0, 1e-9);
}

TEST(BeatsRules, BeatSabersRowsRiseWithThePlayerByHalf) {
  const Settings settings = settingsOf(R"({"rules": "beat_saber", "player_height_m": 2.0})");
  EXPECT_NEAR(rowHeight_m(settings.layout, 0.0), 0.95, 1e-12);
  EXPECT_NEAR(rowHeight_m(settings.layout, 1.0), 1.50, 1e-12);
  EXPECT_NEAR(rowHeight_m(settings.layout, 2.0), 2.00, 1e-12);
  EXPECT_NEAR(rowHeight_m(settings.layout, 0.5), 1.225, 1e-12);
  EXPECT_NEAR(rowHeight_m(settings.layout, 3.0), 2.50, 1e-12);
  // Rows 0 and 1: from 0.675 to 1.75 m.
  const Block wall = wallAt(settings.layout, emptyLevel(), {1.0, 1.0, 0.0, 0.0, 1.0, 2.0}, 0.0);
  EXPECT_NEAR(wall.center_m.y(), (0.675 + 1.75) / 2.0, 1e-12);
  EXPECT_NEAR(wall.half_m.y(), (1.75 - 0.675) / 2.0, 1e-12);
  EXPECT_TRUE(settings.score.swing);
  EXPECT_TRUE(settings.floor_origin);
}

TEST(BeatsRules, EvenRowsReplaceThoseOfTheRules) {
  const Settings settings =
      settingsOf(R"({"rules": "beat_saber", "middle_row_m": 1.3, "cell_height_m": 0.4})");
  EXPECT_NEAR(rowHeight_m(settings.layout, 2.0), 1.7, 1e-12);
  const Settings paper = settingsOf("{}");
  EXPECT_FALSE(paper.layout.rows_m || paper.layout.hit_box_m || paper.score.swing);
  EXPECT_EQ(rowHeight_m(paper.layout, 2.0), -0.30 + 0.35);
}

TEST(BeatsRules, BadOptionsNameTheOption) {
  const auto refused = [](const std::string& json) -> std::string {
    try {
      settingsOf(json);
    } catch (const InvalidArgument& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_NE(refused(R"({"rules": "original"})").find("rules"), std::string::npos);
  EXPECT_NE(refused(R"({"row_heights_m": [1, 2]})").find("row_heights_m"), std::string::npos);
  EXPECT_NE(refused(R"({"row_heights_m": [1, 3, 2]})").find("rising"), std::string::npos);
  EXPECT_NE(refused(R"({"row_heights_m": [1, 2, 3], "middle_row_m": 1})").find("middle_row_m"),
            std::string::npos);
  EXPECT_NE(refused(R"({"hit_box_m": [1]})").find("hit_box_m"), std::string::npos);
  EXPECT_NE(refused(R"({"player_height_m": 1.8})").find("player_height_m"), std::string::npos);
}

// 12 m in 2 s; the jump of 12 m begins 6 m before the cut plane.
TEST(BeatsRules, TheApproachReplacesTheLevels) {
  const Settings settings = settingsOf(R"({"approach_mps": 12, "jump_distance_m": 12})");
  const Level level = makeLevel(settings.level, 1);
  EXPECT_EQ(level.speed_mps, 12.0);
  EXPECT_EQ(level.approach_s, 0.5);
  const Level own = makeLevel(settingsOf("{}").level, 1);
  EXPECT_EQ(own.speed_mps, 5.0);
}

// A box of 0.4 m at 1 s in the column from 0 to 0.6 m, middle at x = 0.3 and y = 1.4; the floor's
// origin follows the head's z. A downward blade at x = 0.6 is 10 cm beside the box and in the hit
// box, which reaches to 0.7; an upward one is in the hit box, too, and cuts nothing.
Level saberBox() {
  Level level = emptyLevel(3.0);
  level.boxes = {{1.0, 2.0, 1.0, Hand::kRight, CutDirection::kDown}};
  return level;
}
constexpr const char* kOriginal = R"({"rules": "beat_saber", "end_on_miss": false})";

TEST(BeatsRules, ACorrectCutReachesFurtherThanTheBox) {
  for (const double up : {-1.0, 1.0}) {
    BeatsRound round(saberBox(), kOriginal);
    round.waitUntil(0.9);
    round.stroke(Hand::kRight, {0.6, 1.4 - 0.3 * up, 0.0}, {0.6, 1.4 + 0.2 * up, 0.0});
    EXPECT_EQ(round.tally().slices(), up < 0.0 ? 1 : 0);
    EXPECT_EQ(round.tally().errors(), 0.0);
    round.waitUntil(3.1);
    EXPECT_EQ(round.tally().misses(), up < 0.0 ? 0 : 1);
  }
}

// A straight stroke turns by nothing: of 115 points the centre's alone, in the middle of the box
// 15. They come when the swing is over, 0.4 s later, with the multiplier of the cut.
TEST(BeatsRules, PointsComeWhenTheSwingIsOver) {
  BeatsRound round(saberBox(), kOriginal);
  round.waitUntil(0.9);
  round.stroke(Hand::kRight, {0.3, 1.7, 0.0}, {0.3, 1.2, 0.0});
  EXPECT_EQ(round.tally().slices(), 1);
  EXPECT_EQ(round.tally().score(), 0);
  Stance still;
  still.right.position = {0.3, 1.2, 0.0};
  round.waitUntil(1.6, still);
  EXPECT_EQ(round.tally().score(), 15);
  EXPECT_EQ(round.rewardSum(), 15.0);
}

TEST(BeatsRules, TheLaneFollowsTheHeadOverTheFloor) {
  BeatsRound round(saberBox(), kOriginal);
  Stance stance;
  round.frame(stance);
  stance.head = {0.2, 1.5, 0.3};
  round.frame(stance);
  EXPECT_LT((round.round().origin_m() - Vec3(0.0, 0.0, 0.3)).norm(), 1e-6)
      << round.round().origin_m().transpose();
}

}  // namespace
}  // namespace sim2vr::games::beats

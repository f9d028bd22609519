// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "beats/level.hpp"
#include "beats/round.hpp"
#include "beats/swing.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180.0;

Box boxOf(CutDirection cut, double offset_deg = 0.0) {
  return {1.0, 2.0, 1.0, Hand::kRight, cut, offset_deg};
}
Vec3 along(double degrees, double speed = 1.0) {
  return {speed * std::cos(degrees * kDegree), speed * std::sin(degrees * kDegree), 0.0};
}

// 50 + 75 (s - 0.5) / 4.5 + 75 (1 - angle / 60).
TEST(BeatsScore, IsThePagesFormula) {
  const ScoreRules rules;
  EXPECT_EQ(cutPoints(rules, 5.0, 0.0), 200);
  EXPECT_EQ(cutPoints(rules, 50.0, 0.0), 200);
  EXPECT_EQ(cutPoints(rules, 2.75, 30.0), 125);
  EXPECT_EQ(cutPoints(rules, 0.5, 60.0), 50);
  EXPECT_EQ(cutPoints(rules, 0.5, 0.0), 125);
  EXPECT_EQ(cutPoints(rules, 5.0, 60.0), 125);
  // 50 + 75 / 3 + 75 * 3 / 4 = 131.25.
  EXPECT_EQ(cutPoints(rules, 2.0, 15.0), 131);
  EXPECT_EQ(cutPoints({1.0, 2.0, 90.0}, 1.5, 45.0), 125);
}

TEST(BeatsScore, AnglesAreFromTheDemandedDirection) {
  EXPECT_NEAR(*cutAngle_deg(boxOf(CutDirection::kDown), {0.0, -3.0, 0.0}), 0.0, 1e-12);
  EXPECT_NEAR(*cutAngle_deg(boxOf(CutDirection::kDown), {0.0, 3.0, 0.0}), 180.0, 1e-12);
  EXPECT_NEAR(*cutAngle_deg(boxOf(CutDirection::kUp), {0.0, 2.0, 9.0}), 0.0, 1e-12);
  EXPECT_NEAR(*cutAngle_deg(boxOf(CutDirection::kLeft), along(180.0 + 30.0)), 30.0, 1e-9);
  EXPECT_NEAR(*cutAngle_deg(boxOf(CutDirection::kRight), along(-45.0)), 45.0, 1e-9);
  EXPECT_NEAR(*cutAngle_deg(boxOf(CutDirection::kUpLeft), along(135.0)), 0.0, 1e-9);
  EXPECT_NEAR(*cutAngle_deg(boxOf(CutDirection::kUpRight), along(45.0)), 0.0, 1e-9);
  EXPECT_NEAR(*cutAngle_deg(boxOf(CutDirection::kDownLeft), along(225.0)), 0.0, 1e-9);
  EXPECT_NEAR(*cutAngle_deg(boxOf(CutDirection::kDownRight), along(-45.0)), 0.0, 1e-9);
  // Counter-clockwise from down is towards the right.
  EXPECT_NEAR(*cutAngle_deg(boxOf(CutDirection::kDown, 30.0), along(-60.0)), 0.0, 1e-9);
  EXPECT_EQ(*cutAngle_deg(boxOf(CutDirection::kAny), along(77.0)), 0.0);
  EXPECT_FALSE(cutAngle_deg(boxOf(CutDirection::kDown), {0.0, 0.0, 5.0}));
}

TEST(BeatsScore, BoxesAreTurnedAsTheyAreCut) {
  EXPECT_NEAR(boxTurn_rad(boxOf(CutDirection::kDown)), 0.0, 1e-12);
  EXPECT_NEAR(boxTurn_rad(boxOf(CutDirection::kAny, 20.0)), 20.0 * kDegree, 1e-12);
  // What points down on a box that is not turned points along the cut on one that is.
  for (int i = 0; i < 9; ++i) {
    const Box box = boxOf(static_cast<CutDirection>(i), 7.0);
    const Vec3 mark = Eigen::AngleAxisd(boxTurn_rad(box), Vec3::UnitZ()) * -Vec3::UnitY();
    if (box.cut == CutDirection::kAny) continue;
    EXPECT_NEAR(mark.x(), cutVector(box).x(), 1e-12) << i;
    EXPECT_NEAR(mark.y(), cutVector(box).y(), 1e-12) << i;
  }
}

TEST(BeatsTally, MultiplierRisesAfterTwoSixAndFourteen) {
  Multiplier multiplier;
  std::vector<int> factors;
  for (int i = 0; i < 16; ++i) {
    factors.push_back(multiplier.factor());
    multiplier.addSlice();
  }
  EXPECT_EQ(factors, (std::vector{1, 1, 2, 2, 2, 2, 4, 4, 4, 4, 4, 4, 4, 4, 8, 8}));
  multiplier.addFault();
  EXPECT_EQ(multiplier.factor(), 4);
  for (int i = 0; i < 8; ++i) multiplier.addSlice();
  EXPECT_EQ(multiplier.factor(), 8);
  for (int i = 0; i < 5; ++i) multiplier.addFault();
  EXPECT_EQ(multiplier.factor(), 1);
}

// 0.5 + 2 * 0.01 - 0.10 - 0.15 - 0.15 = 0.12; 0.1 s in a wall takes 0.13.
TEST(BeatsTally, KeepsScoreComboAndEnergy) {
  Tally tally(/*multiply=*/true);
  tally.addSlice(100, 2.0, 10.0);
  tally.addSlice(100, 4.0, 20.0);
  EXPECT_EQ(tally.factor(), 2);
  EXPECT_EQ(tally.combo(), 2);
  tally.addFault(Fault::kWrongHand);
  tally.addFault(Fault::kMine);
  tally.addFault(Fault::kMiss);
  EXPECT_EQ(tally.combo(), 0);
  EXPECT_EQ(tally.longestCombo(), 2);
  EXPECT_EQ(tally.score(), 200);
  EXPECT_EQ(tally.errors(), 2.0);
  EXPECT_EQ(tally.misses(), 1);
  EXPECT_NEAR(tally.energy(), 0.12, 1e-12);
  EXPECT_EQ(tally.meanSpeed_mps(), 3.0);
  EXPECT_EQ(tally.meanAngle_deg(), 15.0);
  tally.addWallTime(0.1, 5.0);
  EXPECT_EQ(tally.energy(), 0.0);
  EXPECT_EQ(tally.errors(), 2.5);
  tally.addSlice(100, 1.0, 0.0);
  EXPECT_EQ(tally.energy(), 0.0) << "what is used up stays so";
}

}  // namespace
}  // namespace sim2vr::games::beats

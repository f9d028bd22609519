// SPDX-License-Identifier: Apache-2.0
// The task of ISO 9241-411 without a scene: the circle, the order, what is measured.
#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <utility>
#include <vector>

#include "pointing/rules.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::pointing {
namespace {

TEST(PointingCircle, TargetsComeUpOppositeEachOther) {
  const std::vector<int> nine{0, 5, 1, 6, 2, 7, 3, 8, 4, 0};
  for (int trial = 0; trial <= 9; ++trial) {
    EXPECT_EQ(targetOfTrial(trial, 9), nine[static_cast<std::size_t>(trial)]) << trial;
  }
  const std::vector<int> three{0, 2, 1, 0};
  for (int trial = 0; trial <= 3; ++trial) {
    EXPECT_EQ(targetOfTrial(trial, 3), three[static_cast<std::size_t>(trial)]) << trial;
  }
}

// Three targets 0.3 m apart: an equilateral triangle, 0.3 / sqrt(3) from its centre.
TEST(PointingCircle, ATriangleByHand) {
  EXPECT_TRUE(targetCenter_m(0, 3, 0.3).isApprox(Vec3(0.0, 0.173205, 0.0), 1e-5));
  EXPECT_TRUE(targetCenter_m(1, 3, 0.3).isApprox(Vec3(0.15, -0.0866025, 0.0), 1e-5));
  EXPECT_TRUE(targetCenter_m(2, 3, 0.3).isApprox(Vec3(-0.15, -0.0866025, 0.0), 1e-5));
}

TEST(PointingCircle, EveryMovementIsAsLongAsTheDistance) {
  for (const int targets : {3, 9, 13, 25}) {
    for (int trial = 1; trial <= targets; ++trial) {
      const Vec3 from = targetCenter_m(targetOfTrial(trial - 1, targets), targets, 0.18);
      const Vec3 to = targetCenter_m(targetOfTrial(trial, targets), targets, 0.18);
      EXPECT_NEAR((to - from).norm(), 0.18, 1e-12) << targets << " " << trial;
    }
  }
}

TEST(PointingCircle, NineIndicesOfDifficultyByHand) {
  // log2(D / W + 1) with D / W of 20/9, 10/3, 4, 5, 6, 64/9, 9, 32/3 and 16.
  const std::vector<double> expected{1.688, 2.115, 2.322, 2.585, 2.807, 3.020, 3.322, 3.544, 4.087};
  std::set<double> found;
  for (const Block& block : drawBlocks({}, 1)) found.insert(block.index_bits());
  ASSERT_EQ(found.size(), expected.size());
  auto index = found.begin();
  for (const double bits : expected) EXPECT_NEAR(*index++, bits, 5e-4);
}

std::vector<std::pair<double, double>> pairs(const std::vector<Block>& blocks) {
  std::vector<std::pair<double, double>> all;
  for (const Block& block : blocks) all.emplace_back(block.distance_m, block.width_m);
  return all;
}

TEST(PointingCircle, BlocksComeInSeededOrderEachAsOftenAsTheOthers) {
  Settings settings;
  settings.repeats = 2;
  const auto one = pairs(drawBlocks(settings, 1));
  ASSERT_EQ(one.size(), 18U);
  for (std::size_t half = 0; half < 2; ++half) {
    const auto begin = one.begin() + static_cast<std::ptrdiff_t>(9 * half);
    EXPECT_EQ(std::set(begin, begin + 9).size(), 9U);
  }
  EXPECT_EQ(pairs(drawBlocks(settings, 1)), one);
  std::set<std::pair<double, double>> firsts;
  for (std::uint32_t seed = 1; seed <= 40; ++seed) {
    firsts.insert(pairs(drawBlocks(settings, seed)).front());
  }
  EXPECT_EQ(firsts.size(), 9U);
}

TEST(PointingEffective, AMovementAlongTheTaskAxis) {
  const Movement straight =
      movementOf({0.0, 0.0, 0.4}, {0.3, 0.0, 0.4}, {0.01, 0.02, 0.4}, {0.295, -0.03, 0.4}, 0.6);
  EXPECT_DOUBLE_EQ(straight.time_s, 0.6);
  EXPECT_NEAR(straight.offset_m, -0.005, 1e-12);
  EXPECT_NEAR(straight.length_m, 0.285, 1e-12);
  // Along (3, 4) / 5: 1 cm up is 8 mm too far.
  const Movement oblique =
      movementOf(Vec3::Zero(), {0.3, 0.4, 0.0}, Vec3::Zero(), {0.3, 0.41, 0.0}, 0.5);
  EXPECT_NEAR(oblique.offset_m, 0.008, 1e-12);
  EXPECT_NEAR(oblique.length_m, 0.508, 1e-12);
}

// Offsets of -4, 0 and 4 mm: a standard deviation of 4 mm, 16.532 mm wide; log2(100 / 16.532 + 1)
// is 2.8174 bits, in 0.6 s.
TEST(PointingEffective, ABlockByHand) {
  MovementSums sums;
  sums.add({0.5, -0.004, 0.096});
  EXPECT_FALSE(sums.effective());
  sums.add({0.6, 0.0, 0.100});
  sums.add({0.7, 0.004, 0.104});
  const auto block = sums.effective();
  ASSERT_TRUE(block);
  EXPECT_NEAR(block->deviation_m, 0.004, 1e-12);
  EXPECT_NEAR(block->width_m(), 0.016532, 1e-9);
  EXPECT_NEAR(block->distance_m, 0.100, 1e-12);
  EXPECT_NEAR(block->movement_time_s, 0.6, 1e-12);
  EXPECT_NEAR(block->index_bits(), 2.8174, 1e-4);
  EXPECT_NEAR(block->throughput_bps(), 2.8174 / 0.6, 2e-4);
}

TEST(PointingEffective, SelectionsWithoutSpreadHaveNoWidth) {
  MovementSums sums;
  for (int i = 0; i < 9; ++i) sums.add({0.5, 0.003, 0.1});
  EXPECT_FALSE(sums.effective());
  EXPECT_EQ(sums.count(), 9);
}

std::string refusal(const std::string& options_json) {
  Options options = Options::fromJson(options_json);
  try {
    Settings::fromOptions(options);
  } catch (const InvalidArgument& error) {
    return error.what();
  }
  return "";
}

TEST(PointingSettings, SayWhatTheyExpect) {
  EXPECT_EQ(refusal(R"({"targets": 8})"),
            "option 'targets': got 8, expected an odd number, so that the next target is opposite");
  EXPECT_EQ(refusal(R"({"targets": 9.5})"),
            "option 'targets': got 9.500000, expected a whole number");
  EXPECT_EQ(refusal(R"({"widths_m": [0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09]})"),
            "option 'widths_m': got 27 pairs of a distance and a width, expected at most 25");
  EXPECT_EQ(refusal(R"({"distances_m": []})"),
            "option 'distances_m': got none, expected at least one length");
  EXPECT_NE(refusal(R"({"distances_m": [0.0]})"), "");
  EXPECT_EQ(refusal(R"({"targets": 13, "distances_m": [0.2], "widths_m": [0.02, 0.03]})"), "");
}

TEST(PointingSettings, TellALogWhatIsUnusual) {
  EXPECT_EQ(Settings().playOptionsJson(), "{}");
  Options options = Options::fromJson(R"({"targets": 13, "hand": "left", "error_cost": 0})");
  EXPECT_EQ(Settings::fromOptions(options).playOptionsJson(), R"({"hand":"left","targets":13})");
}

}  // namespace
}  // namespace sim2vr::games::pointing

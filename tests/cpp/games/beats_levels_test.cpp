// SPDX-License-Identifier: Apache-2.0
// The levels that come with Beats, and the options that choose them.
#include <gtest/gtest.h>

#include "beats/level_options.hpp"

namespace sim2vr::games::beats {
namespace {

Level play(std::string_view options_json, std::uint32_t seed = 1) {
  Options options = Options::fromJson(options_json);
  const LevelSettings settings = readLevelSettings(options);
  options.expectAllRead();
  return makeLevel(settings, seed);
}

TEST(BeatsFirst, IsFourDiagonalCutsInTenSeconds) {
  const Level level = play("{}");
  EXPECT_EQ(level.name, "first");
  ASSERT_EQ(level.boxes.size(), 4U);
  EXPECT_TRUE(level.mines.empty());
  EXPECT_TRUE(level.walls.empty());
  for (std::size_t i = 0; i < 4; ++i) {
    const Box& box = level.boxes[i];
    const bool left = i % 2 == 0;
    EXPECT_EQ(box.hand, left ? Hand::kLeft : Hand::kRight);
    EXPECT_EQ(box.column < 1.5, left);
    EXPECT_GE(box.cut, CutDirection::kUpLeft);
    EXPECT_LE(box.cut, CutDirection::kDownRight);
    // One at a time: it appears when the last one is gone.
    if (i > 0) {
      EXPECT_GT(box.time_s - level.approach_s, level.boxes[i - 1].time_s);
    }
    EXPECT_LT(box.time_s, level.length_s);
  }
  EXPECT_EQ(level.length_s, 10.0);
  EXPECT_EQ(level.hash, play(R"({"level": "first"})", 2).hash);
}

}  // namespace
}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
// What holds for generated levels, whatever the seed, and for the level of our own.
#include "beats/level_generator.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

#include "beats/level.hpp"
#include "beats/level_options.hpp"
#include "beats_maps.hpp"

namespace sim2vr::games::beats {
namespace {

/// Distance of a mine from the line of a stroke through a box, in cells, two cells to both sides.
double distanceFromStroke(const Box& box, const Mine& mine) {
  const Eigen::Vector2d apart(mine.column - box.column, mine.row - box.row);
  const Eigen::Vector2d cut = cutVector(box);
  return (apart - std::clamp(apart.dot(cut), -2.0, 2.0) * cut).norm();
}

/// Whether a cell lies in a wall's.
bool covers(const Wall& wall, double column, double row) {
  return column + 1.0 > wall.column && column < wall.column + wall.width && row + 1.0 > wall.row &&
         row < wall.row + wall.height;
}

void expectNothingTwice(const Level& level) {
  std::set<std::tuple<double, double, double>> places;
  for (const Box& box : level.boxes) {
    EXPECT_TRUE(places.insert({box.time_s, box.column, box.row}).second) << box.time_s;
  }
  for (const Mine& mine : level.mines) {
    EXPECT_TRUE(places.insert({mine.time_s, mine.column, mine.row}).second) << mine.time_s;
  }
}

void expectFreeStrokes(const Level& level) {
  for (const Mine& mine : level.mines) {
    for (const Box& box : level.boxes) {
      // Half a stroke, and as long as the mine is within 0.9 m of the cut plane.
      if (std::abs(box.time_s - mine.time_s) > 0.15 + 0.9 / level.speed_mps - 1e-9) continue;
      EXPECT_GE(distanceFromStroke(box, mine), 0.75) << mine.time_s;
      EXPECT_GE(std::abs(mine.column - box.column), 2.0) << mine.time_s;
    }
  }
}

void expectWallsThatCanBeDodged(const Level& level) {
  double end_s = 0.0;
  for (const Wall& wall : level.walls) {
    EXPECT_GT(wall.time_s - end_s, 1.0);
    end_s = wall.time_s + wall.duration_s;
    EXPECT_GT(level.approach_s, 0.99);
    // The player stays over the middle: one of the middle columns is free, or the lower two rows.
    EXPECT_TRUE(!covers(wall, 1.0, 1.0) || !covers(wall, 2.0, 1.0)) << wall.time_s;
    for (const Box& box : level.boxes) {
      if (box.time_s > wall.time_s - 0.3 && box.time_s < end_s + 0.1) {
        EXPECT_FALSE(covers(wall, box.column, box.row)) << box.time_s;
      }
    }
  }
}

void expectBackAndForth(const Level& level, double gap_s) {
  for (const Hand hand : {Hand::kLeft, Hand::kRight}) {
    const Box* last = nullptr;
    for (const Box& box : level.boxes) {
      if (box.hand != hand) continue;
      const bool any = box.cut == CutDirection::kAny;
      if (last != nullptr && !any && last->cut != CutDirection::kAny) {
        EXPECT_LT(cutVector(box).dot(cutVector(*last)), -0.7) << box.time_s;
      }
      if (last != nullptr) {
        EXPECT_GE(box.time_s - last->time_s, gap_s);
      }
      last = &box;
    }
  }
}

/// Share of the boxes that lie on their hand's side.
double onOwnSide(const Level& level) {
  const auto own = std::count_if(level.boxes.begin(), level.boxes.end(), [](const Box& box) {
    return (box.column < 1.5) == (box.hand == Hand::kLeft);
  });
  return static_cast<double>(own) / static_cast<double>(level.boxes.size());
}

class BeatsGenerator : public ::testing::TestWithParam<std::string> {};

TEST_P(BeatsGenerator, MakesLevelsThatCanBePlayed) {
  for (std::uint32_t seed = 0; seed < 60; ++seed) {
    SCOPED_TRACE(seed);
    GeneratorSettings settings;
    settings.pattern = GetParam();
    settings.boxes_per_second = 0.3 + 0.3 * (seed % 8);
    settings.speed_mps = 3.0 + seed % 10;
    settings.walls_per_minute = seed % 16;
    settings.mines_per_minute = 3.0 * (seed % 16);
    const Level level = generateLevel(settings, seed);
    expectNothingTwice(level);
    expectFreeStrokes(level);
    expectWallsThatCanBeDodged(level);
    const bool song = settings.pattern == "song";
    expectBackAndForth(level, song ? 0.38 : 0.55);
    if (!song) {
      EXPECT_EQ(onOwnSide(level), 1.0);
    }
    EXPECT_TRUE(levelFacts(level).parity_problems.empty());
    EXPECT_GE(level.boxes.front().time_s, 2.0);
    EXPECT_LE(level.boxes.back().time_s, 59.0);
    EXPECT_TRUE(std::is_sorted(level.boxes.begin(), level.boxes.end(),
                               [](const Box& a, const Box& b) { return a.time_s < b.time_s; }));
  }
}

INSTANTIATE_TEST_SUITE_P(Patterns, BeatsGenerator, ::testing::ValuesIn(generatorPatterns()));

TEST(BeatsGeneratorOptions, SayHowMuchComes) {
  GeneratorSettings settings;
  settings.walls_per_minute = 0.0;
  settings.mines_per_minute = 10.0;
  settings.boxes_per_second = 1.5;
  double boxes = 0.0;
  double mines = 0.0;
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    const Level level = generateLevel(settings, seed);
    EXPECT_TRUE(level.walls.empty());
    boxes += static_cast<double>(level.boxes.size());
    mines += static_cast<double>(level.mines.size());
  }
  // 57 s from the first to the last possible one.
  EXPECT_NEAR(boxes / 20.0, 1.5 * 57.0, 5.0);
  EXPECT_NEAR(mines / 20.0, 10.0, 1.0);
}

TEST(BeatsGeneratorOptions, SongsAreCloseLowAndCross) {
  GeneratorSettings settings{.boxes_per_second = 2.0, .pattern = "song", .speed_mps = 11.0};
  settings.speed_spread_mps = 3.0;
  settings.walls_per_minute = 0.0;
  double boxes = 0.0;
  double own = 0.0;
  double low = 0.0;
  std::set<double> speeds;
  for (std::uint32_t seed = 0; seed < 60; ++seed) {
    const Level level = generateLevel(settings, seed);
    const auto n = static_cast<double>(level.boxes.size());
    boxes += n;
    own += n * onOwnSide(level);
    low += static_cast<double>(std::count_if(level.boxes.begin(), level.boxes.end(),
                                             [](const Box& box) { return box.row == 0.0; }));
    speeds.insert(level.speed_mps);
    EXPECT_GE(level.speed_mps, 8.0);
    EXPECT_LE(level.speed_mps, 14.0);
  }
  EXPECT_GT(speeds.size(), 10U);
  EXPECT_NEAR(boxes / 60.0, 2.0 * 57.0, 6.0);
  // Half of the boxes lie low; one in six of those that come alone crosses.
  EXPECT_NEAR(low / boxes, 0.5, 0.03);
  EXPECT_NEAR(own / boxes, 0.9, 0.03);
}

TEST(BeatsGeneratorOptions, FixTheBits) {
  Options options = Options::fromJson(R"({"level": "generated", "boxes_per_second": 1.2})");
  const LevelSettings settings = readLevelSettings(options);
  const Level level = makeLevel(settings, 7);
  EXPECT_EQ(makeLevel(settings, 7).hash, level.hash);
  EXPECT_NE(makeLevel(settings, 8).hash, level.hash);
  // The same on every machine and compiler.
  EXPECT_EQ(level.hash, "97d6553189e87c18");
}

TEST(BeatsGeneratorOptions, AreChecked) {
  const auto error = [](const std::string& json) {
    return errorOf([&] {
      Options options = Options::fromJson(json);
      readLevelSettings(options);
    });
  };
  EXPECT_EQ(error(R"({"pattern": "mixt"})"),
            "option 'pattern': got 'mixt', expected one of 'mixed', 'alternating', 'together', "
            "'any' or 'song'; did you mean 'mixed'?");
  EXPECT_EQ(error(R"({"speed_spread_mps": 4.5})"),
            "option 'speed_spread_mps': got 4.5, expected a number from 0.0 to 4.0");
  EXPECT_EQ(error(R"({"boxes_per_second": 9})"),
            "option 'boxes_per_second': got 9, expected a number from 0.1 to 3.0");
  EXPECT_EQ(
      error(R"({"level": "frist"})"),
      "option 'level': got 'frist', expected 'first', 'full' or 'generated', or the path of a "
      "map; did you mean 'first'?");
}

TEST(BeatsFull, IsAMinuteThatCanBePlayed) {
  const Level level = *fullLevel();
  EXPECT_EQ(level.length_s, 60.0);
  EXPECT_EQ(level.beats_per_minute, 100.0);
  const LevelFacts facts = levelFacts(level);
  EXPECT_GE(facts.boxes, 80U);
  EXPECT_GE(facts.mines, 6U);
  EXPECT_GE(facts.walls, 6U);
  EXPECT_TRUE(facts.parity_problems.empty());
  expectNothingTwice(level);
  expectFreeStrokes(level);
  expectWallsThatCanBeDodged(level);
  // As a map in a folder it is the same.
  EXPECT_EQ(loadLevel(SIM2VR_SOURCE_DIR "/app_runtime/games/beats/levels/full", "", "").hash,
            level.hash);
}

TEST(BeatsFacts, FindStrokesThatDoNotGoBack) {
  Level level;
  level.length_s = 10.0;
  using enum CutDirection;
  level.boxes = {{1.0, 1, 0, Hand::kLeft, kDown}, {1.05, 1, 1, Hand::kLeft, kDown},
                 {1.5, 1, 0, Hand::kLeft, kDown}, {1.6, 2, 0, Hand::kRight, kDown},
                 {2.0, 1, 0, Hand::kLeft, kAny},  {2.4, 1, 0, Hand::kLeft, kUp},
                 {4.0, 1, 0, Hand::kLeft, kUp},   {4.4, 1, 0, Hand::kLeft, kLeft}};
  // 1.05 is the stroke of 1.0; 2.0 is cut upwards, so 2.4 goes on; 4.0 has time; 4.4 is across.
  const LevelFacts facts = levelFacts(level);
  EXPECT_EQ(facts.parity_problems, (std::vector<std::size_t>{2, 5}));
  EXPECT_DOUBLE_EQ(facts.boxes_per_s, 7.0 / 3.4);
  EXPECT_EQ(facts.peak_boxes_per_s, 4.0);
}

}  // namespace
}  // namespace sim2vr::games::beats

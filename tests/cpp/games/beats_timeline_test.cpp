// SPDX-License-Identifier: Apache-2.0
#include "beats/level.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace sim2vr::games::beats {
namespace {

using Json = nlohmann::json;

Json timelineOf(const Level& level) { return Json::parse(timelineJson(level)); }

TEST(BeatsTimeline, PutsThingsIntoLanesRowByRow) {
  Level level;
  level.name = "a level";
  level.length_s = 4.0;
  level.boxes = {{1.0, 2.0, 1.0, Hand::kLeft, CutDirection::kUpRight},
                 {2.0, 0.0, 0.0, Hand::kRight, CutDirection::kAny}};
  level.mines = {{3.0, 3.0, 2.0}};
  // To duck: the top row of the four columns, though it is wider and higher.
  level.walls = {{1.5, 0.5, -2.0, 2.0, 9.0, 3.0}};
  const Json items = timelineOf(level)["items"];
  ASSERT_EQ(items.size(), 4U);
  EXPECT_EQ(items[0]["shape"], "bar");
  EXPECT_EQ(items[0]["lane"], 8.0);
  EXPECT_EQ(items[0]["lanes"], 4.0);
  EXPECT_EQ(items[0]["duration_s"], 0.5);
  EXPECT_EQ(items[1]["lane"], 11.0);
  EXPECT_EQ(items[2]["lane"], 6.0);
  EXPECT_DOUBLE_EQ(items[2]["arrow_deg"], 45.0);
  EXPECT_EQ(items[2]["kind"], "left box");
  EXPECT_EQ(items[3]["lane"], 0.0);
  EXPECT_FALSE(items[3].contains("arrow_deg"));
}

TEST(BeatsTimeline, TurnsTheArrowByTheAngleOffset) {
  Level level;
  level.boxes = {{1.0, 1.0, 0.0, Hand::kLeft, CutDirection::kDown, 30.0}};
  EXPECT_NEAR(timelineOf(level)["items"][0]["arrow_deg"].get<double>(), -60.0, 1e-9);
}

TEST(BeatsTimeline, HasItsBeatsOverAChangeOfTempo) {
  Level level;
  level.length_s = 4.0;
  level.beats_per_minute = 60.0;
  // In the middle of the second beat: the rest of it goes twice as fast.
  level.tempo_changes = {{1.5, 120.0}};
  EXPECT_EQ(timelineOf(level)["beats_s"].get<std::vector<double>>(),
            (std::vector<double>{0.0, 1.0, 1.75, 2.25, 2.75, 3.25, 3.75}));
}

TEST(BeatsTimeline, HasTheLevelItself) {
  Level level;
  level.hash = "abc";
  level.speed_mps = 7.0;
  level.boxes = {{1.0, 2.5, 1.0, Hand::kRight, CutDirection::kAny}};
  level.walls = {{1.5, 0.5, -2.0, 2.0, 9.0, 3.0}};
  const Json content = timelineOf(level)["level"];
  EXPECT_EQ(content["hash"], "abc");
  EXPECT_EQ(content["speed_mps"], 7.0);
  EXPECT_EQ(content["boxes"][0]["hand"], 1);
  EXPECT_EQ(content["boxes"][0]["cut"], 8);
  EXPECT_EQ(content["boxes"][0]["column"], 2.5);
  EXPECT_EQ(content["walls"][0]["column"], -2.0);
  EXPECT_TRUE(content["mines"].empty());
}

}  // namespace
}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
// Maps of the three versions of Beat Saber's format. The files in tests/data/beats_maps are the
// same music, written by hand from the formats' description (bsmg.wiki/mapping/map-format).
#include "beats_maps.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "beats/level.hpp"
#include "beats/map_files.hpp"
#include "own_folder.hpp"

namespace sim2vr::games::beats {
namespace {

using testing::readEasy;
using testing::readEasy3;

const std::string kMaps = SIM2VR_TEST_DATA_DIR "/beats_maps/";

TEST(BeatsTempo, FollowsChanges) {
  // 120 a minute up to beat 8: 4 s; 60 up to beat 12: 4 s more; then 240.
  const TempoMap tempo(120.0, {{8.0, 60.0}, {12.0, 240.0}});
  EXPECT_DOUBLE_EQ(tempo.seconds(0.0), 0.0);
  EXPECT_DOUBLE_EQ(tempo.seconds(4.0), 2.0);
  EXPECT_DOUBLE_EQ(tempo.seconds(8.0), 4.0);
  EXPECT_DOUBLE_EQ(tempo.seconds(10.0), 6.0);
  EXPECT_DOUBLE_EQ(tempo.seconds(12.0), 8.0);
  EXPECT_DOUBLE_EQ(tempo.seconds(16.0), 9.0);
  EXPECT_DOUBLE_EQ(tempo.beatsPerMinuteAt(9.0), 60.0);
}

TEST(BeatsTempo, OfTwoChangesAtABeatTheLastCounts) {
  const TempoMap tempo(120.0, {{0.0, 30.0}, {2.0, 240.0}, {2.0, 60.0}});
  EXPECT_DOUBLE_EQ(tempo.seconds(2.0), 4.0);
  EXPECT_DOUBLE_EQ(tempo.seconds(3.0), 5.0);
}

TEST(BeatsTempo, OfRegionsCountsFromBeatZero) {
  // The music begins with half a second before beat 0; behind its end its last tempo goes on.
  const TempoMap tempo({{0.0, 4.0, 0.5, 2.5}, {4.0, 8.0, 2.5, 3.5}});
  EXPECT_DOUBLE_EQ(tempo.seconds(0.0), 0.0);
  EXPECT_DOUBLE_EQ(tempo.seconds(2.0), 1.0);
  EXPECT_DOUBLE_EQ(tempo.seconds(6.0), 2.5);
  EXPECT_DOUBLE_EQ(tempo.seconds(12.0), 4.0);
}

TEST(BeatsMap, HasItsTimesInSeconds) {
  const Level level = loadLevel(kMaps + "v2", "", "");
  EXPECT_EQ(level.name, "Three ways (Hard)");
  EXPECT_EQ(level.beats_per_minute, 120.0);
  ASSERT_EQ(level.tempo_changes.size(), 2U);
  EXPECT_EQ(level.tempo_changes[1].time_s, 8.0);
  EXPECT_EQ(level.tempo_changes[1].beats_per_minute, 240.0);
  ASSERT_EQ(level.boxes.size(), 4U);
  EXPECT_EQ(level.boxes[0].time_s, 2.0);
  EXPECT_EQ(level.boxes[0].hand, Hand::kLeft);
  EXPECT_EQ(level.boxes[0].cut, CutDirection::kDown);
  EXPECT_EQ(level.boxes[2].time_s, 6.0);
  EXPECT_EQ(level.boxes[2].column, 3.0);
  EXPECT_EQ(level.boxes[2].row, 2.0);
  EXPECT_EQ(level.boxes[2].cut, CutDirection::kUpRight);
  EXPECT_EQ(level.boxes[3].time_s, 8.5);
  EXPECT_EQ(level.boxes[3].cut, CutDirection::kAny);
  ASSERT_EQ(level.mines.size(), 2U);
  EXPECT_EQ(level.mines[0].time_s, 4.0);
  EXPECT_EQ(level.mines[1].time_s, 8.0);
  ASSERT_EQ(level.walls.size(), 2U);
  // Beats 6 to 10, over a change of tempo.
  EXPECT_EQ(level.walls[0].time_s, 3.0);
  EXPECT_EQ(level.walls[0].duration_s, 3.0);
  EXPECT_EQ(level.walls[0].row, 0.0);
  EXPECT_EQ(level.walls[0].height, 5.0);
  EXPECT_EQ(level.walls[1].row, 2.0);
  EXPECT_EQ(level.walls[1].height, 3.0);
  EXPECT_EQ(level.walls[1].width, 4.0);
  EXPECT_EQ(level.walls[1].duration_s, 0.5);
  // Its end at 9.0 s, and a second.
  EXPECT_EQ(level.length_s, 10.0);
  // 4 beats of 0.5 s at 10 m/s are 20 m, too far; 2 are 10 m.
  EXPECT_EQ(level.speed_mps, 10.0);
  EXPECT_EQ(level.approach_s, 1.0);
}

TEST(BeatsMap, IsTheSameInAllVersions) {
  const Level second = loadLevel(kMaps + "v2", "Standard", "hard");
  for (const char* version : {"v3", "v4"}) {
    const Level other = loadLevel(kMaps + version, "", "");
    EXPECT_EQ(contentHash(other), contentHash(second)) << version;
    EXPECT_NE(other.hash, second.hash) << version;
  }
}

TEST(BeatsMap, OfOneFileFindsItsInfo) {
  EXPECT_EQ(contentHash(loadLevel(kMaps + "v3/Hard.dat", "", "")),
            contentHash(loadLevel(kMaps + "v3", "", "")));
  EXPECT_EQ(errorOf([] { loadLevel(kMaps + "v3/Hard.dat", "", "Hard"); }),
            "option 'difficulty': got 'Hard' with a single difficulty, expected none, or the map's "
            "folder or archive as the level");
}

TEST(BeatsMap, WithATempoOfItsOwnNeedsNoInfo) {
  const sim2vr::testing::OwnFolder folder;
  const std::string path = (folder / "alone.json").string();
  const auto write = [&](const std::string& text) {
    std::ofstream(path) << text;
    return path;
  };
  const std::string with =
      write(R"({"version": "3.0.0", "bpmEvents": [{"b": 0, "m": 30}], "colorNotes": [{"b": 3}]})");
  const Level level = loadLevel(with, "", "");
  EXPECT_EQ(level.boxes.at(0).time_s, 6.0);
  EXPECT_EQ(level.name, "alone");
  const std::string without = write(R"({"version": "3.0.0", "colorNotes": [{"b": 3}]})");
  EXPECT_EQ(errorOf([&] { loadLevel(without, "", ""); }),
            without +
                ": got a difficulty without tempo, expected an Info.dat beside it that lists "
                "it, or its own tempo at beat 0");
}

TEST(BeatsMap, TurnsByTheAngleOffset) {
  const Level level =
      readEasy(R"({"version": "3.0.0", "colorNotes": [{"b": 1, "c": 1, "d": 1, "a": -45}]})");
  EXPECT_EQ(level.boxes.at(0).angle_offset_deg, -45.0);
}

TEST(BeatsMap, ApproachIsTheHalfJumpDuration) {
  // 60 beats a minute: 4 and 2 beats at 10 m/s are 40 and 20 m; 1 beat is 10 m.
  EXPECT_EQ(approachSeconds(10.0, 0.0, 60.0), 1.0);
  EXPECT_EQ(approachSeconds(10.0, 0.5, 60.0), 1.5);
  EXPECT_EQ(approachSeconds(10.0, -3.0, 60.0), 0.25);
  // 200 a minute: 4 beats are 1.2 s, at 15 m/s 18 m: half of that.
  EXPECT_EQ(approachSeconds(15.0, 0.0, 200.0), 0.6);
  EXPECT_EQ(approachSeconds(14.9, 0.0, 200.0), 1.2);
  EXPECT_EQ(jumpSpeed_mps({.difficulty = "Hard"}), 10.0);
  EXPECT_EQ(jumpSpeed_mps({.difficulty = "Expert"}), 12.0);
  EXPECT_EQ(jumpSpeed_mps({.difficulty = "Expert+"}), 16.0);
  EXPECT_EQ(jumpSpeed_mps({.difficulty = "Expert+", .speed_mps = 9.0}), 9.0);
}

TEST(BeatsChain, HasItsHeadAndLinksOnTheCurve) {
  // Straight down over two rows; two links in the first half of the way.
  const Level level = readEasy3(
      R"("burstSliders": [{"b": 2, "x": 1, "y": 2, "c": 0, "d": 1, "tb": 3, "tx": 1, "ty": 0,
         "sc": 3, "s": 0.5}])");
  ASSERT_EQ(level.boxes.size(), 4U);
  EXPECT_FALSE(level.boxes[1].link);
  EXPECT_EQ(level.boxes[1].cut, CutDirection::kDown);
  EXPECT_TRUE(level.boxes[2].link);
  EXPECT_EQ(level.boxes[2].cut, CutDirection::kAny);
  EXPECT_EQ(level.boxes[2].hand, Hand::kLeft);
  // (1 - t)^2 2 + 2 (1 - t) t 1 with t = 0.25 and 0.5.
  EXPECT_DOUBLE_EQ(level.boxes[2].row, 1.5);
  EXPECT_DOUBLE_EQ(level.boxes[2].time_s, 2.5);
  EXPECT_DOUBLE_EQ(level.boxes[3].row, 1.0);
  EXPECT_DOUBLE_EQ(level.boxes[3].column, 1.0);
  EXPECT_DOUBLE_EQ(level.boxes[3].time_s, 3.0);
}

TEST(BeatsChain, BendsInTheHeadsDirectionAndTakesTheBoxThatIsThere) {
  // From (0, 0) upwards to (2, 0): the middle point is (0, 1), half way is (0.5, 0.5).
  const Level level = readEasy(
      R"({"version": "4.0.0", "colorNotes": [{"b": 2, "i": 0}],
          "colorNotesData": [{"x": 0, "y": 0, "c": 1, "d": 0}],
          "chains": [{"hb": 2, "tb": 4, "i": 0, "ci": 0}],
          "chainsData": [{"tx": 2, "ty": 0, "c": 3, "s": 1}]})");
  ASSERT_EQ(level.boxes.size(), 3U);
  EXPECT_FALSE(level.boxes[0].link);
  EXPECT_DOUBLE_EQ(level.boxes[1].column, 0.5);
  EXPECT_DOUBLE_EQ(level.boxes[1].row, 0.5);
  EXPECT_DOUBLE_EQ(level.boxes[1].time_s, 3.0);
  EXPECT_DOUBLE_EQ(level.boxes[2].column, 2.0);
  EXPECT_DOUBLE_EQ(level.boxes[2].row, 0.0);
}

}  // namespace
}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
// What is wrong with a map is said with its file, object and field.
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <zip.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>

#include "beats/beatmap.hpp"
#include "beats/map_files.hpp"
#include "beats_maps.hpp"
#include "own_folder.hpp"
#include "sim2vr/core/log.hpp"

namespace sim2vr::games::beats {
namespace {

using testing::readEasy;
using testing::readEasy3;

struct Case {
  std::string objects;
  std::string error;
};

void PrintTo(const Case& test, std::ostream* out) { *out << test.error; }

class BeatsMapErrors3 : public ::testing::TestWithParam<Case> {};

TEST_P(BeatsMapErrors3, NameTheField) {
  EXPECT_EQ(errorOf([&] { readEasy3(GetParam().objects); }), "map: Easy.dat." + GetParam().error);
}

INSTANTIATE_TEST_SUITE_P(
    Objects, BeatsMapErrors3,
    ::testing::Values(
        Case{R"("bombNotes": [{"b": 1}, {"b": -0.5}])",
             "bombNotes[1].b: got -0.5, expected a number from 0.0 to 1000000.0"},
        Case{R"("bombNotes": [{"b": 1, "x": 1000}])",
             "bombNotes[0].x: got 1000, expected a whole number from 0 to 3"},
        Case{R"("bombNotes": [{"b": "1"}])", "bombNotes[0].b: got \"1\", expected a number"},
        Case{R"("bombNotes": 3)", "bombNotes: got 3, expected an array"},
        Case{R"("obstacles": [{"b": 1, "d": -1, "w": 1, "h": 1}])",
             "obstacles[0].d: got -1.0, expected a number from 0.0 to 2000.0"},
        Case{R"("obstacles": [{"b": 1, "d": 10000, "w": 1, "h": 1}])",
             "obstacles[0].d: got 10000.0, expected a number from 0.0 to 2000.0"},
        Case{R"("obstacles": [{"b": 1, "d": 1, "w": 0, "h": 1}])",
             "obstacles[0].w: got 0, expected a whole number from 1 to 50"},
        Case{R"("bpmEvents": [{"b": 1, "m": 0}])",
             "bpmEvents[0].m: got 0.0, expected a number from 1.0 to 100000.0"},
        Case{R"("bpmEvents": [{"b": 1}])", "bpmEvents[0].m: got none, expected beats per minute"},
        Case{R"("rotationEvents": [{"b": 1, "r": 15}])",
             "rotationEvents[0].r: got 15.0, expected 0: lanes that turn about the player are not "
             "played"},
        Case{R"("burstSliders": [{"b": 1, "tb": 2, "sc": 0}])",
             "burstSliders[0].sc: got 0, expected a whole number from 1 to 1000"}));

TEST(BeatsMapErrors, OfVersion2NameTheField) {
  const auto of = [](const std::string& notes) {
    return errorOf([&] { readEasy(R"({"_notes": [)" + notes + "]}"); });
  };
  EXPECT_EQ(of(R"({"_time": 1, "_lineIndex": 1, "_lineLayer": 0, "_type": 2})"),
            "map: Easy.dat._notes[0]._type: got 2, expected 0 (left hand), 1 (right hand) or 3 "
            "(mine)");
  EXPECT_EQ(of(R"({"_time": 1, "_lineIndex": 1, "_lineLayer": 0, "_type": 0})"),
            "map: Easy.dat._notes[0]._cutDirection: got none, expected a number");
  EXPECT_EQ(
      of(R"({"_time": 1, "_lineIndex": 1, "_lineLayer": 0, "_type": 0, "_cutDirection": 1090})"),
      "map: Easy.dat._notes[0]._cutDirection: got 1090, expected a whole number from 0 to 8");
  EXPECT_EQ(errorOf([] {
              readEasy(R"({"_notes": [], "_obstacles": [{"_time": 1, "_lineIndex": 1, "_type": 1100,
                           "_duration": 1, "_width": 1}]})");
            }),
            "map: Easy.dat._obstacles[0]._type: got 1100, expected a whole number from 0 to 2");
  EXPECT_EQ(errorOf([] { readEasy(R"({"_notes": []})"); }),
            "map: Easy.dat: got no boxes, expected boxes to cut");
}

TEST(BeatsMapErrors, OfVersion4NameTheIndex) {
  EXPECT_EQ(errorOf([] {
              readEasy(R"({"version": "4.0.0", "colorNotes": [{"b": 1, "i": 1}],
                           "colorNotesData": [{"x": 1}]})");
            }),
            "map: Easy.dat.colorNotes[0].i: got 1, expected an index into the 1 entries of "
            "colorNotesData");
}

TEST(BeatsMapErrors, OfRegionsNameTheRegion) {
  const auto read = [](const std::string& regions) {
    return readRegions(R"({"songFrequency": 10, "bpmData": [)" + regions + "]}", "audio");
  };
  const std::string first = R"({"si": 0, "ei": 40, "sb": 0, "eb": 4}, )";
  EXPECT_EQ(errorOf([&] { read(first + R"({"si": 30, "ei": 50, "sb": 4, "eb": 5})"); }),
            "audio.bpmData[1].si: got 30.0, expected a number from 40.0 to 1000000000000.0");
  EXPECT_EQ(errorOf([&] { read(first + R"({"si": 40, "ei": 40, "sb": 4, "eb": 5})"); }),
            "audio.bpmData[1].eb: got inf, expected a region of 1 to 100,000 beats per minute");
  // A gap belongs to the earlier one: it ends at beat 6 and 5 s, so that time never goes back.
  const auto regions = read(first + R"({"si": 50, "ei": 60, "sb": 6, "eb": 7})");
  EXPECT_EQ(regions[0].end_beat, 6.0);
  EXPECT_EQ(regions[0].end_s, 5.0);
}

TEST(BeatsMapErrors, NameTheVersions) {
  EXPECT_EQ(errorOf([] { readEasy(R"({"version": "5.0.0"})"); }),
            "map: Easy.dat.version: got '5.0.0', expected a difficulty of version 2, 3 or 4");
  EXPECT_EQ(errorOf([] { readEasy(R"({"_version": "1.5.0", "_notes": []})"); }),
            "map: Easy.dat._version: got '1.5.0', expected a difficulty of version 2, 3 or 4");
  EXPECT_EQ(errorOf([] { readEasy("{}"); }),
            "map: Easy.dat.version: got none, expected a difficulty of version 2, 3 or 4");
  EXPECT_TRUE(errorOf([] {
                readEasy(R"({"_notes": [{"_time": NaN}]})");
              }).starts_with("map: Easy.dat: got no JSON (NaN and Infinity are none either)"));
  EXPECT_EQ(errorOf([] { readEasy(std::string(40, '[')); }),
            "map: Easy.dat: got JSON nested deeper, expected 32 levels at most");
}

TEST(BeatsMapErrors, BoundTheNumberOfObjects) {
  std::string bombs = "{}";
  for (int i = 0; i < 100'000; ++i) bombs += ",{}";
  EXPECT_EQ(errorOf([&] { readEasy3(R"("bombNotes": [)" + bombs + "]"); }),
            "map: Easy.dat.bombNotes: got 100001 objects, expected 100000 at most");
  EXPECT_EQ(errorOf([] { readEasy3(R"("bombNotes": [{"b": 100000}])"); }),
            "map: Easy.dat: got 100001.000000 s of play, expected 4 hours at most");
}

TEST(BeatsMapErrors, ListWhatAMapOffers) {
  MapInfo info;
  info.difficulties = {
      {"Standard", "Easy", "a"}, {"Standard", "ExpertPlus", "b"}, {"OneSaber", "Hard", "c"}};
  EXPECT_EQ(matchingDifficulties(info, "", "expert+").at(0).file, "b");
  EXPECT_EQ(matchingDifficulties(info, "onesaber", "").at(0).file, "c");
  const auto all = matchingDifficulties(info, "", "");
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(all[0].file, "b");
  EXPECT_EQ(all[1].file, "a");
  EXPECT_EQ(errorOf([&] { matchingDifficulties(info, "", "Eazy"); }),
            "option 'difficulty': got 'Eazy', expected one of 'Easy' or 'ExpertPlus'; did you mean "
            "'Easy'? (of the characteristic 'Standard')");
  EXPECT_EQ(errorOf([&] { matchingDifficulties(info, "Lawless", ""); }),
            "option 'characteristic': got 'Lawless', expected one of 'Standard' or 'OneSaber'");
}

TEST(BeatsMapErrors, KeepInfoInItsFolder) {
  const auto info = [](const std::string& file) {
    return R"({"_version": "2.0.0", "_beatsPerMinute": 60, "_difficultyBeatmapSets": [
      {"_beatmapCharacteristicName": "Standard", "_difficultyBeatmaps": [
        {"_difficulty": "Easy", "_beatmapFilename": ")" +
           file + R"("}]}]})";
  };
  const std::string field =
      "Info.dat._difficultyBeatmapSets[0]._difficultyBeatmaps[0]._beatmapFilename: got ";
  for (const std::string name :
       {"../Easy.dat", "/etc/passwd", "a\\\\Easy.dat", "C:Easy.dat", ".."}) {
    const std::string error =
        errorOf([&] { readMapLevel(MemoryFiles({{"Info.dat", info(name)}}, "map"), "", ""); });
    EXPECT_TRUE(error.starts_with("map: " + field) && error.ends_with("without a folder")) << error;
  }
  EXPECT_EQ(
      errorOf([&] { readMapLevel(MemoryFiles({{"info.dat", info("X.dat")}}, "map"), "", ""); }),
      "map: X.dat: got no such file, expected the file that Info.dat names");
  EXPECT_EQ(errorOf([&] { readMapLevel(MemoryFiles({}, "map"), "", ""); }),
            "map: got no Info.dat in it, expected a map with its Info.dat");
}

/// A map whose Expert needs an extension, whose ExpertPlus has no file, and whose Hard is plain.
MapFiles& mapWithProblems() {
  static MemoryFiles files(
      {{"Info.dat", R"({"_version": "2.0.0", "_beatsPerMinute": 60, "_difficultyBeatmapSets": [
          {"_beatmapCharacteristicName": "Standard", "_difficultyBeatmaps": [
            {"_difficulty": "Easy", "_beatmapFilename": "H.dat"},
            {"_difficulty": "Hard", "_beatmapFilename": "H.dat"},
            {"_difficulty": "Expert", "_beatmapFilename": "H.dat", "_customData":
              {"_requirements": ["Noodle Extensions"]}},
            {"_difficulty": "ExpertPlus", "_beatmapFilename": "../H.dat"}]}]})"},
       {"H.dat", R"({"version": "3.0.0", "colorNotes": [{"b": 1}]})"}},
      "map");
  return files;
}

TEST(BeatsMapErrors, RefuseModificationsThatMoveThings) {
  EXPECT_EQ(errorOf([] { readMapLevel(mapWithProblems(), "", "Expert"); }),
            "map: Info.dat._difficultyBeatmapSets[0]._difficultyBeatmaps[2]._customData._"
            "requirements: got 'Noodle Extensions', expected a difficulty without it: the places "
            "of its boxes are not the formats'");
}

TEST(BeatsMap, ChecksNothingButThePlayedDifficulty) {
  EXPECT_EQ(readMapLevel(mapWithProblems(), "", "Hard").boxes.size(), 1U);
}

TEST(BeatsMap, TakesTheHardestThatPlaysWithOneNote) {
  std::ostringstream text;
  const auto sink = std::make_shared<spdlog::sinks::ostream_sink_mt>(text);
  sink->set_pattern("%v");
  logger().sinks().push_back(sink);
  const Level level = readMapLevel(mapWithProblems(), "", "");
  logger().sinks().pop_back();
  EXPECT_EQ(level.name, " (Hard)");
  EXPECT_EQ(level.hash, readMapLevel(mapWithProblems(), "", "Hard").hash);
  EXPECT_EQ(text.str(),
            "map: no difficulty given, 'Hard' is the hardest that can be played of 'ExpertPlus', "
            "'Expert', 'Hard' or 'Easy'\n");
}

TEST(BeatsMapErrors, SayThatAMapIsNotUtf8) {
  const auto with = [](const std::string& info) {
    return errorOf([&] { readMapLevel(MemoryFiles({{"Info.dat", info}}, "map"), "", ""); });
  };
  EXPECT_EQ(
      with("{\"_songName\": \"K\xe4se\"}"),
      "map: Info.dat: got text that is not UTF-8 at byte 16, expected a JSON object in UTF-8");
  EXPECT_EQ(with(std::string("\xff\xfe{\0}\0", 6)),
            "map: Info.dat: got text in UTF-16, expected a JSON object in UTF-8");
}

TEST(BeatsMapErrors, NameAMapOfVersion1) {
  EXPECT_EQ(errorOf([] { readMapLevel(MemoryFiles({{"info.json", "{}"}}, "map"), "", ""); }),
            "map: got a map of version 1, with info.json, expected one of version 2, 3 or 4, with "
            "Info.dat");
}

TEST(BeatsMap, IsMeantByItsOtherFiles) {
  const sim2vr::testing::OwnFolder folder;
  const auto write = [&](const char* name, const std::string& text) {
    std::ofstream(folder / name) << text;
    return (folder / name).string();
  };
  const std::string lights = write("Lightshow.dat", R"({"version": "4.0.0", "basicEvents": []})");
  EXPECT_EQ(errorOf([&] { loadLevel(lights, "", ""); }),
            lights +
                ": got no notes in it, expected a difficulty, or a map's folder, archive or "
                "Info.dat");
  write("Easy.dat", R"({"version": "3.0.0", "colorNotes": [{"b": 1}]})");
  const std::string info = write("Info.dat", testing::easyInfo());
  const std::string hash = loadLevel(folder.path().string(), "", "").hash;
  for (const std::string& file : {info, lights, write("BPMInfo.dat", R"({"_version": "2.0.0"})")}) {
    EXPECT_EQ(loadLevel(file, "", "").hash, hash);
    EXPECT_EQ(loadLevel(file, "Standard", "easy").hash, hash);
  }
}

TEST(BeatsMap, WarnsOnceOfUnknownFields) {
  std::ostringstream text;
  const auto sink = std::make_shared<spdlog::sinks::ostream_sink_mt>(text);
  sink->set_pattern("%v");
  logger().sinks().push_back(sink);
  for (int round = 0; round < 2; ++round) {
    readEasy3(
        R"("glitter": 1, "customData": {}, "bombNotes": [{"b": 1, "z": 1}, {"b": 2, "z": 1}])");
  }
  logger().sinks().pop_back();
  EXPECT_EQ(text.str(),
            "map: Easy.dat: unknown or not played: 'bombNotes.z' (2 times), 'glitter'\n");
}

/// A zip archive of these files.
std::string zipped(const std::map<std::string, std::string>& files) {
  const sim2vr::testing::OwnFolder folder;
  const std::string path = (folder / "map.zip").string();
  int error = 0;
  zip_t* zip = zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, &error);
  for (const auto& [name, bytes] : files) {
    zip_source_t* source = zip_source_buffer(zip, bytes.data(), bytes.size(), 0);
    zip_file_add(zip, name.c_str(), source, 0);
  }
  EXPECT_EQ(zip_close(zip), 0);
  return readBytes(path, kMaximumArchiveBytes);
}

Level readZip(const std::string& bytes) { return readMapLevel(*filesOfZip(bytes, "zip"), "", ""); }

TEST(BeatsZip, IsTheMapThatIsInIt) {
  const std::string easy = R"({"version": "3.0.0", "colorNotes": [{"b": 1}]})";
  const Level folder = readEasy(easy);
  const Level plain = readZip(zipped({{"info.dat", testing::easyInfo()}, {"EASY.DAT", easy}}));
  EXPECT_EQ(plain.boxes.size(), 1U);
  EXPECT_EQ(plain.hash, folder.hash);
  const Level nested =
      readZip(zipped({{"map/Info.dat", testing::easyInfo()}, {"map/Easy.dat", easy}, {"x", ""}}));
  EXPECT_EQ(nested.hash, folder.hash);
}

TEST(BeatsZip, RefusesWhatIsNoMap) {
  EXPECT_EQ(errorOf([] { readZip("PK, or so"); }).substr(0, 27), "zip: got no zip archive (No");
  EXPECT_EQ(errorOf([] { readZip(zipped({{"a/b.txt", "x"}})); }),
            "zip: got no Info.dat in it, expected a map with its Info.dat");
  EXPECT_EQ(errorOf([] { readZip(zipped({{"Info.dat", "{}"}, {"../Easy.dat", "{}"}})); }),
            "zip: got the entry '../Easy.dat', expected entries that stay in the archive");
  EXPECT_EQ(errorOf([] { readZip(zipped({{"Info.dat", testing::easyInfo()}})); }),
            "zip: Easy.dat: got no such file, expected the file that Info.dat names");
}

TEST(BeatsZip, StopsUnpackingABomb) {
  const std::string zeros(kMaximumMapFileBytes + 1, ' ');
  const std::string bomb = zipped({{"Info.dat", zeros}});
  EXPECT_LT(bomb.size(), 100'000U);
  EXPECT_EQ(errorOf([&] { readZip(bomb); }),
            "zip: Info.dat: got a larger file, expected 64 MiB at most");
}

TEST(BeatsZip, NoticesDamage) {
  std::string bytes =
      zipped({{"Info.dat", testing::easyInfo()}, {"Easy.dat", std::string(5000, 'x')}});
  bytes[60] = static_cast<char>(bytes[60] ^ 0x55);
  const std::string error = errorOf([&] { readZip(bytes); });
  EXPECT_TRUE(error.starts_with("zip: ")) << error;
}

}  // namespace
}  // namespace sim2vr::games::beats

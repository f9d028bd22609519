// SPDX-License-Identifier: Apache-2.0
#include "beats/map_info.hpp"

#include <algorithm>
#include <cctype>

#include "beats/map_reader.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr std::size_t kMaximumDifficulties = 200;

/// Lower case, "expert+" spelt out.
std::string folded(std::string_view name) {
  std::string text;
  for (const char letter : name) {
    if (letter == '+') {
      text += "plus";
    } else {
      text += static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
    }
  }
  return text;
}

/// The name of a file beside Info.dat. A map from outside must not name others.
std::string fileName(const JsonFields& object, const char* field) {
  object.expect(field, "the name of a file beside Info.dat");
  std::string name = object.text(field, "");
  const bool leads_away = name.find_first_of("/\\:") != std::string::npos || name == "." ||
                          name == ".." || name.find('\0') != std::string::npos;
  if (name.empty() || leads_away) {
    throw InvalidArgument(object.path(field), "'" + name + "'",
                          "the name of a file beside Info.dat, without a folder");
  }
  return name;
}

/// Modifications of the game that put things elsewhere than the formats say.
void expectPlainPlaces(const JsonFields& difficulty, const char* custom, const char* requirements) {
  const auto data = difficulty.object(custom);
  if (!data) return;
  for (const std::string& name : data->texts(requirements)) {
    if (name != "Noodle Extensions" && name != "Mapping Extensions") continue;
    throw InvalidArgument(data->path(requirements), "'" + name + "'",
                          "a difficulty without it: the places of its boxes are not the formats'");
  }
}

/// 0: the difficulty's usual one.
double readSpeed(const JsonFields& object, const char* name) {
  const double speed_mps = object.number(name, 0.0);
  return speed_mps == 0.0 ? 0.0 : object.number(name, 0.0, 1.0, 1000.0);
}

double readOffset(const JsonFields& object, const char* name) {
  return object.number(name, 0.0, -100.0, 100.0);
}

/// How a version of Info.dat names the fields of a difficulty.
struct EntryFields {
  const char* difficulty;
  const char* file;
  const char* speed;
  const char* offset;
  const char* custom;
  const char* requirements;
};
constexpr EntryFields kFields2{
    "_difficulty", "_beatmapFilename", "_noteJumpMovementSpeed", "_noteJumpStartBeatOffset",
    "_customData", "_requirements"};
constexpr EntryFields kFields4{
    "difficulty", "beatmapDataFilename", "noteJumpMovementSpeed", "noteJumpStartBeatOffset",
    "customData", "requirements"};

/// The name must be readable; every other problem matters to those alone who play it.
MapDifficulty readEntry(const JsonFields& entry, const std::string& characteristic,
                        const EntryFields& fields) {
  MapDifficulty read{.characteristic = characteristic,
                     .difficulty = entry.text(fields.difficulty, "")};
  try {
    read.file = fileName(entry, fields.file);
    read.speed_mps = readSpeed(entry, fields.speed);
    read.offset_beats = readOffset(entry, fields.offset);
    expectPlainPlaces(entry, fields.custom, fields.requirements);
  } catch (const InvalidArgument& problem) {
    read.problem = problem;
  }
  return read;
}

MapInfo readInfo2(const JsonFields& info, UnknownFields& unknown) {
  unknown.look(info, "",
               {"_version", "_songName", "_songSubName", "_songAuthorName", "_levelAuthorName",
                "_beatsPerMinute", "_songTimeOffset", "_shuffle", "_shufflePeriod",
                "_previewStartTime", "_previewDuration", "_songFilename", "_coverImageFilename",
                "_environmentName", "_allDirectionsEnvironmentName", "_environmentNames",
                "_colorSchemes", "_difficultyBeatmapSets"});
  MapInfo read;
  read.title = info.text("_songName", "");
  read.beats_per_minute = readTempo(info, "_beatsPerMinute");
  for (const JsonFields& set : mapObjects(info, "_difficultyBeatmapSets")) {
    set.expect("_beatmapCharacteristicName", "a characteristic such as 'Standard'");
    for (const JsonFields& difficulty : mapObjects(set, "_difficultyBeatmaps")) {
      unknown.look(difficulty, "_difficultyBeatmaps",
                   {"_difficulty", "_difficultyRank", "_beatmapFilename", "_noteJumpMovementSpeed",
                    "_noteJumpStartBeatOffset", "_beatmapColorSchemeIdx", "_environmentNameIdx"});
      difficulty.expect("_difficulty", "a difficulty such as 'Easy'");
      read.difficulties.push_back(
          readEntry(difficulty, set.text("_beatmapCharacteristicName", ""), kFields2));
    }
  }
  return read;
}

MapInfo readInfo4(const JsonFields& info, UnknownFields& unknown) {
  unknown.look(info, "",
               {"version", "song", "audio", "songPreviewFilename", "coverImageFilename",
                "environmentNames", "colorSchemes", "difficultyBeatmaps"});
  MapInfo read;
  if (const auto song = info.object("song")) read.title = song->text("title", "");
  info.expect("audio", "an object with 'bpm'");
  const JsonFields audio = *info.object("audio");
  read.beats_per_minute = readTempo(audio, "bpm");
  read.song_s = audio.number("songDuration", 0.0, 0.0, 1e6);
  if (!audio.text("audioDataFilename", "").empty()) {
    read.audio_file = fileName(audio, "audioDataFilename");
  }
  for (const JsonFields& difficulty : mapObjects(info, "difficultyBeatmaps")) {
    unknown.look(difficulty, "difficultyBeatmaps",
                 {"characteristic", "difficulty", "beatmapAuthors", "environmentNameIdx",
                  "beatmapColorSchemeIdx", "noteJumpMovementSpeed", "noteJumpStartBeatOffset",
                  "beatmapDataFilename", "lightshowDataFilename"});
    difficulty.expect("characteristic", "a characteristic such as 'Standard'");
    difficulty.expect("difficulty", "a difficulty such as 'Easy'");
    read.difficulties.push_back(
        readEntry(difficulty, difficulty.text("characteristic", ""), kFields4));
  }
  return read;
}

/// Every characteristic once, in the map's order.
std::vector<std::string> characteristics(const MapInfo& info) {
  std::vector<std::string> names;
  for (const MapDifficulty& offered : info.difficulties) {
    if (std::find(names.begin(), names.end(), offered.characteristic) == names.end()) {
      names.push_back(offered.characteristic);
    }
  }
  return names;
}

/// Harder ones have higher ranks; names that the game does not have come last.
std::ptrdiff_t rank(const MapDifficulty& difficulty) {
  static const std::vector<std::string> kNames{"easy", "normal", "hard", "expert", "expertplus"};
  const auto found = std::find(kNames.begin(), kNames.end(), folded(difficulty.difficulty));
  return found == kNames.end() ? -1 : found - kNames.begin();
}

std::string got(const std::string& name) { return name.empty() ? "none" : "'" + name + "'"; }

std::string chooseCharacteristic(const MapInfo& info, const std::string& wanted) {
  const std::vector<std::string> names = characteristics(info);
  const std::string meant = wanted.empty() ? "Standard" : wanted;
  for (const std::string& name : names) {
    if (folded(name) == folded(meant)) return name;
  }
  if (wanted.empty() && names.size() == 1) return names.front();
  throw InvalidArgument("option 'characteristic'", got(wanted), oneOf(names, wanted));
}

}  // namespace

MapInfo readMapInfo(std::string_view text, const std::string& place) {
  const nlohmann::json json = parseJson(text, place, kMaximumMapValues);
  const JsonFields info(json, place);
  const bool old = info.has("_version");
  const char* field = old ? "_version" : "version";
  const std::string version = info.text(field, "");
  UnknownFields unknown(place);
  MapInfo read;
  if (old && version.starts_with("2.")) {
    read = readInfo2(info, unknown);
  } else if (!old && version.starts_with("4.")) {
    read = readInfo4(info, unknown);
  } else {
    throw InvalidArgument(info.path(field), got(version), "an Info.dat of version 2 or 4");
  }
  if (read.difficulties.empty() || read.difficulties.size() > kMaximumDifficulties) {
    throw InvalidArgument(place, std::to_string(read.difficulties.size()) + " difficulties",
                          "1 to " + std::to_string(kMaximumDifficulties));
  }
  unknown.warn();
  return read;
}

std::vector<MapDifficulty> matchingDifficulties(const MapInfo& info,
                                                const std::string& characteristic,
                                                const std::string& difficulty) {
  const std::string set = chooseCharacteristic(info, characteristic);
  std::vector<std::string> names;
  std::vector<MapDifficulty> all;
  for (const MapDifficulty& offered : info.difficulties) {
    if (offered.characteristic != set) continue;
    if (folded(offered.difficulty) == folded(difficulty)) return {offered};
    names.push_back(offered.difficulty);
    all.push_back(offered);
  }
  if (!difficulty.empty()) {
    throw InvalidArgument("option 'difficulty'", got(difficulty),
                          oneOf(names, difficulty) + " (of the characteristic '" + set + "')");
  }
  std::stable_sort(all.begin(), all.end(), [](const MapDifficulty& a, const MapDifficulty& b) {
    return rank(a) > rank(b);
  });
  return all;
}

double jumpSpeed_mps(const MapDifficulty& difficulty) {
  if (difficulty.speed_mps > 0.0) return difficulty.speed_mps;
  const std::string name = folded(difficulty.difficulty);
  if (name == "expertplus") return 16.0;
  return name == "expert" ? 12.0 : 10.0;
}

double approachSeconds(double speed_mps, double offset_beats, double beats_per_minute) {
  constexpr double kFurthest_m = 17.999;
  constexpr double kFewestBeats = 0.25;
  const double beat_s = 60.0 / beats_per_minute;
  double beats = 4.0;
  while (speed_mps * beat_s * beats > kFurthest_m) beats /= 2.0;
  return std::max(beats + offset_beats, kFewestBeats) * beat_s;
}

}  // namespace sim2vr::games::beats

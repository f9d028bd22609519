// SPDX-License-Identifier: Apache-2.0
#include "beats/beatmap.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <mutex>
#include <set>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/core/text.hpp"

namespace sim2vr::games::beats {
namespace {

/// How far walls may lie beyond the grid, and their largest size, in cells.
constexpr std::int64_t kWallCells = 50;
/// Longer than any song.
constexpr double kMaximumWallBeats = 2000.0;
constexpr std::int64_t kMaximumSlices = 1000;
constexpr std::size_t kShownFields = 6;

bool isCustom(const std::string& name) {
  return name == "customData" || name == "_customData" || name == "_customEvents";
}

constexpr std::int64_t kMineType = 3;
constexpr std::int64_t kTempoEvent = 100;
constexpr std::int64_t kEarlyRotation = 14;
constexpr std::int64_t kLateRotation = 15;

void expectFields(const JsonFields& object, std::initializer_list<const char*> names) {
  for (const char* name : names) object.expect(name, "a number");
}

void readNote(const JsonFields& note, Beatmap& beatmap) {
  expectFields(note, {"_time", "_lineIndex", "_lineLayer", "_type"});
  const double beat = readBeat(note, "_time");
  const double column = readColumn(note, "_lineIndex");
  const double row = readRow(note, "_lineLayer");
  const std::int64_t type = note.integer("_type", 0, 0, kMineType);
  if (type == kMineType) {
    beatmap.mines.push_back({beat, {0.0, column, row}});
    return;
  }
  if (type > 1) {
    throw InvalidArgument(note.path("_type"), std::to_string(type),
                          "0 (left hand), 1 (right hand) or 3 (mine)");
  }
  note.expect("_cutDirection", "a number");
  const Hand hand = type == 0 ? Hand::kLeft : Hand::kRight;
  beatmap.boxes.push_back({beat, {0.0, column, row, hand, readCut(note, "_cutDirection")}});
}

void readObstacle(const JsonFields& obstacle, Beatmap& beatmap) {
  expectFields(obstacle, {"_time", "_lineIndex", "_type", "_duration", "_width"});
  BeatWall wall{readBeat(obstacle, "_time"), readWallBeats(obstacle, "_duration"), {}};
  const std::int64_t type = obstacle.integer("_type", 0, 0, 2);
  if (type == 2) {
    expectFields(obstacle, {"_lineLayer", "_height"});
    wall.wall = readWall(obstacle, "_lineIndex", "_lineLayer", "_width", "_height");
  } else {
    // What the game itself makes of its old types: the whole height, or the upper part.
    wall.wall = readWallColumns(obstacle, "_lineIndex", "_width");
    wall.wall.row = type == 0 ? 0.0 : 2.0;
    wall.wall.height = type == 0 ? 5.0 : 3.0;
  }
  beatmap.walls.push_back(wall);
}

void readEvent(const JsonFields& event, Beatmap& beatmap) {
  // Most are lights, of which nothing is asked.
  const double type = event.number("_type", 0.0);
  if (type == kTempoEvent) {
    event.expect("_time", "a number");
    beatmap.tempo_changes.push_back({readBeat(event, "_time"), readTempo(event, "_floatValue")});
  }
  if (type == kEarlyRotation || type == kLateRotation) {
    throw InvalidArgument(event.path("_type"), std::to_string(static_cast<int>(type)),
                          "no event 14 or 15: lanes that turn about the player are not played");
  }
}

Box readBox(const JsonFields& note) {
  return {0.0,
          readColumn(note, "x"),
          readRow(note, "y"),
          readHand(note, "c"),
          readCut(note, "d"),
          note.number("a", 0.0, -360.0, 360.0)};
}

Chain readChain(const JsonFields& chain) {
  Chain read;
  read.beat = readBeat(chain, "b");
  read.tail_beat = readBeat(chain, "tb");
  read.head = readBox(chain);
  read.tail_column = readColumn(chain, "tx");
  read.tail_row = readRow(chain, "ty");
  readLinks(chain, "sc", read);
  return read;
}

void readObjects(const JsonFields& map, Beatmap& beatmap, UnknownFields& unknown) {
  for (const JsonFields& note : mapObjects(map, "colorNotes")) {
    unknown.look(note, "colorNotes", {"b", "x", "y", "c", "d", "a"});
    beatmap.boxes.push_back({readBeat(note, "b"), readBox(note)});
  }
  for (const JsonFields& bomb : mapObjects(map, "bombNotes")) {
    unknown.look(bomb, "bombNotes", {"b", "x", "y"});
    beatmap.mines.push_back(
        {readBeat(bomb, "b"), {0.0, readColumn(bomb, "x"), readRow(bomb, "y")}});
  }
  for (const JsonFields& obstacle : mapObjects(map, "obstacles")) {
    unknown.look(obstacle, "obstacles", {"b", "d", "x", "y", "w", "h"});
    beatmap.walls.push_back({readBeat(obstacle, "b"), readWallBeats(obstacle, "d"),
                             readWall(obstacle, "x", "y", "w", "h")});
  }
  for (const JsonFields& chain : mapObjects(map, "burstSliders")) {
    unknown.look(chain, "burstSliders",
                 {"b", "x", "y", "c", "d", "a", "tb", "tx", "ty", "sc", "s"});
    beatmap.chains.push_back(readChain(chain));
  }
}

/// The entry of `data` that a field points to.
const JsonFields& pointed(const JsonFields& object, const char* name,
                          const std::vector<JsonFields>& data, const char* data_name) {
  const std::int64_t index = object.integer(name, 0, 0, INT32_MAX);
  if (static_cast<std::size_t>(index) < data.size()) return data[static_cast<std::size_t>(index)];
  throw InvalidArgument(
      object.path(name), std::to_string(index),
      "an index into the " + std::to_string(data.size()) + " entries of " + data_name);
}

std::vector<JsonFields> readData(const JsonFields& map, const char* name, UnknownFields& unknown,
                                 std::initializer_list<std::string_view> known) {
  std::vector<JsonFields> data = mapObjects(map, name);
  for (const JsonFields& entry : data) unknown.look(entry, name, known);
  return data;
}

void readNotes(const JsonFields& map, Beatmap& beatmap, UnknownFields& unknown) {
  const auto data = readData(map, "colorNotesData", unknown, {"x", "y", "c", "d", "a"});
  for (const JsonFields& note : mapObjects(map, "colorNotes")) {
    unknown.look(note, "colorNotes", {"b", "r", "i"});
    expectNoRotation(note, "r");
    beatmap.boxes.push_back(
        {readBeat(note, "b"), readBox(pointed(note, "i", data, "colorNotesData"))});
  }
  const auto links = readData(map, "chainsData", unknown, {"tx", "ty", "c", "s"});
  for (const JsonFields& chain : mapObjects(map, "chains")) {
    unknown.look(chain, "chains", {"hb", "tb", "hr", "tr", "i", "ci"});
    expectNoRotation(chain, "hr");
    const JsonFields& tail = pointed(chain, "ci", links, "chainsData");
    Chain read;
    read.beat = readBeat(chain, "hb");
    read.tail_beat = readBeat(chain, "tb");
    read.head = readBox(pointed(chain, "i", data, "colorNotesData"));
    read.tail_column = readColumn(tail, "tx");
    read.tail_row = readRow(tail, "ty");
    readLinks(tail, "c", read);
    beatmap.chains.push_back(read);
  }
}

void readBombs(const JsonFields& map, Beatmap& beatmap, UnknownFields& unknown) {
  const auto data = readData(map, "bombNotesData", unknown, {"x", "y"});
  for (const JsonFields& bomb : mapObjects(map, "bombNotes")) {
    unknown.look(bomb, "bombNotes", {"b", "r", "i"});
    expectNoRotation(bomb, "r");
    const JsonFields& place = pointed(bomb, "i", data, "bombNotesData");
    beatmap.mines.push_back(
        {readBeat(bomb, "b"), {0.0, readColumn(place, "x"), readRow(place, "y")}});
  }
}

void readObstacles(const JsonFields& map, Beatmap& beatmap, UnknownFields& unknown) {
  const auto data = readData(map, "obstaclesData", unknown, {"d", "x", "y", "w", "h"});
  for (const JsonFields& obstacle : mapObjects(map, "obstacles")) {
    unknown.look(obstacle, "obstacles", {"b", "r", "i"});
    expectNoRotation(obstacle, "r");
    const JsonFields& size = pointed(obstacle, "i", data, "obstaclesData");
    beatmap.walls.push_back(
        {readBeat(obstacle, "b"), readWallBeats(size, "d"), readWall(size, "x", "y", "w", "h")});
  }
}

}  // namespace

void warnOnce(const std::string& warning) {
  constexpr std::size_t kRemembered = 1000;
  static std::mutex mutex;
  static std::set<std::string> said;
  const std::lock_guard lock(mutex);
  if (said.size() < kRemembered && said.insert(warning).second) {
    logger().warn("{}", validUtf8(warning));
  }
}

void UnknownFields::look(const JsonFields& object, std::string_view kind,
                         std::initializer_list<std::string_view> known) {
  for (const std::string& name : object.names()) {
    if (isCustom(name) || std::find(known.begin(), known.end(), name) != known.end()) continue;
    note(kind.empty() ? name : std::string(kind) + "." + name);
  }
}

void UnknownFields::warn() const {
  if (seen_.empty()) return;
  std::string list;
  std::size_t shown = 0;
  for (const auto& [name, count] : seen_) {
    if (shown++ == kShownFields) break;
    list += (list.empty() ? "'" : ", '") + name + "'";
    if (count > 1) list += " (" + std::to_string(count) + " times)";
  }
  if (seen_.size() > kShownFields) {
    list += " and " + std::to_string(seen_.size() - kShownFields) + " more";
  }
  const std::string warning = place_ + ": unknown or not played: " + list;
  warnOnce(warning);
}

std::vector<JsonFields> mapObjects(const JsonFields& map, const char* name) {
  std::vector<JsonFields> found = map.objects(name);
  if (found.size() > kMaximumObjects) {
    throw InvalidArgument(map.path(name), std::to_string(found.size()) + " objects",
                          std::to_string(kMaximumObjects) + " at most");
  }
  return found;
}

double readBeat(const JsonFields& object, const char* name) {
  return object.number(name, 0.0, 0.0, kMaximumBeat);
}

double readWallBeats(const JsonFields& object, const char* name) {
  return object.number(name, 0.0, 0.0, kMaximumWallBeats);
}

double readColumn(const JsonFields& object, const char* name) {
  return static_cast<double>(object.integer(name, 0, 0, 3));
}

double readRow(const JsonFields& object, const char* name) {
  return static_cast<double>(object.integer(name, 0, 0, 2));
}

CutDirection readCut(const JsonFields& object, const char* name) {
  return static_cast<CutDirection>(
      object.integer(name, 0, 0, static_cast<std::int64_t>(CutDirection::kAny)));
}

Hand readHand(const JsonFields& object, const char* name) {
  return object.integer(name, 0, 0, 1) == 0 ? Hand::kLeft : Hand::kRight;
}

Wall readWallColumns(const JsonFields& object, const char* column, const char* width) {
  Wall wall;
  wall.column = static_cast<double>(object.integer(column, 0, -kWallCells, kWallCells));
  wall.width = static_cast<double>(object.integer(width, 0, 1, kWallCells));
  return wall;
}

Wall readWall(const JsonFields& object, const char* column, const char* row, const char* width,
              const char* height) {
  Wall wall = readWallColumns(object, column, width);
  wall.row = static_cast<double>(object.integer(row, 0, -kWallCells, kWallCells));
  wall.height = static_cast<double>(object.integer(height, 0, 1, kWallCells));
  return wall;
}

double readTempo(const JsonFields& object, const char* name) {
  object.expect(name, "beats per minute");
  return object.number(name, 0.0, 1.0, 100'000.0);
}

void readLinks(const JsonFields& object, const char* slices, Chain& chain) {
  chain.slices = static_cast<int>(object.integer(slices, 1, 1, kMaximumSlices));
  chain.squish = object.number("s", 1.0, 0.0, 10.0);
}

void expectNoRotation(const JsonFields& object, const char* name) {
  const double degrees = object.number(name, 0.0);
  if (degrees == 0.0) return;
  throw InvalidArgument(object.path(name), nlohmann::json(degrees).dump(),
                        "0: lanes that turn about the player are not played");
}

Beatmap readBeatmap(std::string_view text, const std::string& place) {
  const nlohmann::json json = parseJson(text, place, kMaximumMapValues);
  const JsonFields map(json, place);
  // Version 2 has an underscore before its names. Old files do not say their version.
  const bool old = map.has("_version") || map.has("_notes");
  const char* field = old ? "_version" : "version";
  const std::string version = map.text(field, old ? "2.0.0" : "");
  UnknownFields unknown(place);
  Beatmap beatmap;
  if (old && version.starts_with("2.")) {
    beatmap = readVersion2(map, unknown);
  } else if (!old && version.starts_with("3.")) {
    beatmap = readVersion3(map, unknown);
  } else if (!old && version.starts_with("4.")) {
    beatmap = readVersion4(map, unknown);
  } else {
    throw InvalidArgument(map.path(field), version.empty() ? "none" : "'" + version + "'",
                          "a difficulty of version 2, 3 or 4");
  }
  beatmap.version = version[0] - '0';
  std::stable_sort(beatmap.tempo_changes.begin(), beatmap.tempo_changes.end(),
                   [](const auto& a, const auto& b) { return a.beat < b.beat; });
  unknown.warn();
  return beatmap;
}

// Version 2: names with an underscore; boxes and mines in one list, tempo among the lights.

Beatmap readVersion2(const JsonFields& map, UnknownFields& unknown) {
  unknown.look(map, "",
               {"_version", "_notes", "_obstacles", "_events", "_sliders", "_waypoints",
                "_specialEventsKeywordFilters"});
  map.expect("_notes", "an array");
  Beatmap beatmap;
  for (const JsonFields& note : mapObjects(map, "_notes")) {
    unknown.look(note, "_notes", {"_time", "_lineIndex", "_lineLayer", "_type", "_cutDirection"});
    readNote(note, beatmap);
  }
  for (const JsonFields& obstacle : mapObjects(map, "_obstacles")) {
    unknown.look(obstacle, "_obstacles",
                 {"_time", "_lineIndex", "_lineLayer", "_type", "_duration", "_width", "_height"});
    readObstacle(obstacle, beatmap);
  }
  for (const JsonFields& event : map.objects("_events")) readEvent(event, beatmap);
  return beatmap;
}

// Version 3: a list for each kind, names of one or two letters. A field that is not there is 0.

Beatmap readVersion3(const JsonFields& map, UnknownFields& unknown) {
  unknown.look(
      map, "",
      {"version", "bpmEvents", "rotationEvents", "colorNotes", "bombNotes", "obstacles", "sliders",
       "burstSliders", "waypoints", "basicBeatmapEvents", "colorBoostBeatmapEvents",
       "lightColorEventBoxGroups", "lightRotationEventBoxGroups", "lightTranslationEventBoxGroups",
       "vfxEventBoxGroups", "_fxEventsCollection", "basicEventTypesWithKeywords",
       "useNormalEventsAsCompatibleEvents"});
  map.expect("colorNotes", "an array");
  Beatmap beatmap;
  readObjects(map, beatmap, unknown);
  for (const JsonFields& rotation : mapObjects(map, "rotationEvents")) {
    expectNoRotation(rotation, "r");
  }
  for (const JsonFields& change : mapObjects(map, "bpmEvents")) {
    unknown.look(change, "bpmEvents", {"b", "m"});
    beatmap.tempo_changes.push_back({readBeat(change, "b"), readTempo(change, "m")});
  }
  return beatmap;
}

// Version 4: what and where in one list, when in another that points into it. A field that is not
// there is 0.

Beatmap readVersion4(const JsonFields& map, UnknownFields& unknown) {
  unknown.look(map, "",
               {"version", "colorNotes", "colorNotesData", "bombNotes", "bombNotesData",
                "obstacles", "obstaclesData", "chains", "chainsData", "arcs", "arcsData",
                "spawnRotations", "spawnRotationsData", "njsEvents", "njsEventData"});
  map.expect("colorNotes", "an array");
  Beatmap beatmap;
  readNotes(map, beatmap, unknown);
  readBombs(map, beatmap, unknown);
  readObstacles(map, beatmap, unknown);
  for (const JsonFields& rotation : mapObjects(map, "spawnRotationsData")) {
    expectNoRotation(rotation, "r");
  }
  if (!mapObjects(map, "njsEvents").empty()) unknown.note("njsEvents");
  return beatmap;
}

namespace {

/// Regions that follow each other without a gap: what lies between two belongs to the earlier one.
void closeGaps(std::vector<TempoMap::Region>& regions, const std::vector<JsonFields>& objects) {
  for (std::size_t i = 0; i < regions.size(); ++i) {
    TempoMap::Region& region = regions[i];
    if (i + 1 < regions.size()) {
      region.end_beat = regions[i + 1].start_beat;
      region.end_s = regions[i + 1].start_s;
    }
    const double beats_per_minute =
        60.0 * (region.end_beat - region.start_beat) / (region.end_s - region.start_s);
    if (beats_per_minute >= 1.0 && beats_per_minute <= 100'000.0) continue;
    throw InvalidArgument(objects[i].path("eb"), fmt::format("{:g}", beats_per_minute),
                          "a region of 1 to 100,000 beats per minute");
  }
}

}  // namespace

std::vector<TempoMap::Region> readRegions(std::string_view text, const std::string& place) {
  const nlohmann::json json = parseJson(text, place, kMaximumMapValues);
  const JsonFields audio(json, place);
  UnknownFields unknown(place);
  unknown.look(
      audio, "",
      {"version", "songChecksum", "songSampleCount", "songFrequency", "bpmData", "lufsData"});
  std::vector<TempoMap::Region> regions;
  const std::vector<JsonFields> objects = mapObjects(audio, "bpmData");
  if (objects.empty()) return regions;
  audio.expect("songFrequency", "samples per second");
  const double frequency_hz = audio.number("songFrequency", 0.0, 1.0, 1e6);
  double last_beat = 0.0;
  double last_sample = 0.0;
  constexpr double kMaximumSample = 1e12;
  for (const JsonFields& object : objects) {
    unknown.look(object, "bpmData", {"si", "ei", "sb", "eb"});
    const double first = object.number("si", 0.0, last_sample, kMaximumSample);
    last_sample = object.number("ei", 0.0, first, kMaximumSample);
    const double start_beat = object.number("sb", 0.0, last_beat, kMaximumBeat);
    last_beat = object.number("eb", 0.0, start_beat, kMaximumBeat);
    regions.push_back({start_beat, last_beat, first / frequency_hz, last_sample / frequency_hz});
  }
  closeGaps(regions, objects);
  unknown.warn();
  return regions;
}

}  // namespace sim2vr::games::beats

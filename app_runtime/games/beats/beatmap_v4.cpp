// SPDX-License-Identifier: Apache-2.0
// Version 4: what and where in one list, when in another that points into it. A field that is not
// there is 0.
#include <fmt/format.h>

#include "beats/map_reader.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats {
namespace {

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

Box readBox(const JsonFields& data) {
  return {0.0,
          readColumn(data, "x"),
          readRow(data, "y"),
          readHand(data, "c"),
          readCut(data, "d"),
          data.number("a", 0.0, -360.0, 360.0)};
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

// SPDX-License-Identifier: Apache-2.0
// Version 2: names with an underscore; boxes and mines in one list, tempo among the lights.
#include "beats/map_reader.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats {
namespace {

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

}  // namespace

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

}  // namespace sim2vr::games::beats

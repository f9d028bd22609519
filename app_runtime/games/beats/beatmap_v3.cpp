// SPDX-License-Identifier: Apache-2.0
// Version 3: a list for each kind, names of one or two letters. A field that is not there is 0.
#include "beats/map_reader.hpp"

namespace sim2vr::games::beats {
namespace {

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

}  // namespace

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

}  // namespace sim2vr::games::beats

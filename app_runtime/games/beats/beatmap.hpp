// SPDX-License-Identifier: Apache-2.0
// One difficulty of a map as it is written, in beats; the three versions of the format have become
// the same.
#pragma once

#include <cstddef>
#include <initializer_list>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "beats/level.hpp"
#include "sim2vr/core/json_reader.hpp"

namespace sim2vr::games::beats {

/// The thing's own time is not set yet.
template <class Thing>
struct AtBeat {
  double beat = 0.0;
  Thing thing;
};

struct BeatWall {
  double beat = 0.0;
  double beats = 0.0;
  Wall wall;
};

/// A head and links on a curve to a tail.
struct Chain {
  double beat = 0.0;
  double tail_beat = 0.0;
  Box head;
  double tail_column = 0.0;
  double tail_row = 0.0;
  /// The head counts.
  int slices = 1;
  /// Share of the curve that the links take.
  double squish = 1.0;
};

struct Beatmap {
  int version = 0;
  std::vector<AtBeat<Box>> boxes;
  std::vector<AtBeat<Mine>> mines;
  std::vector<BeatWall> walls;
  std::vector<Chain> chains;
  /// Of versions 2 and 3; version 4 has them beside the music.
  std::vector<TempoMap::Change> tempo_changes;
};

/// Reads a difficulty of version 2, 3 or 4. `place` names the file in errors. Fields that the
/// formats do not have are one warning in the log. Throws InvalidArgument naming file, object and
/// field.
Beatmap readBeatmap(std::string_view json, const std::string& place);

/// The beats and samples of version 4's audio file; none when it has no regions. Throws as
/// readBeatmap does.
std::vector<TempoMap::Region> readRegions(std::string_view json, const std::string& place);

// What the readers of the versions share: limits, places in the grid, and unknown fields.

/// Boxes, mines, walls and chains of a level, each.
inline constexpr std::size_t kMaximumObjects = 100'000;
inline constexpr double kMaximumBeat = 1e6;
/// Values in a file: lights may be many.
inline constexpr std::size_t kMaximumMapValues = 2'000'000;

/// One line in the log, once in a process: a level is read anew for every round.
void warnOnce(const std::string& warning);

/// Fields that a file has and its format has not.
class UnknownFields {
 public:
  explicit UnknownFields(std::string place) : place_(std::move(place)) {}

  /// Notes the fields of an object that are not among `known`. What modifications of the game add
  /// (customData) is known, and not played.
  void look(const JsonFields& object, std::string_view kind,
            std::initializer_list<std::string_view> known);
  /// Notes something that is not played though it is there.
  void note(const std::string& what) { ++seen_[what]; }
  /// One line in the log for the file, once in a process; none when there was nothing.
  void warn() const;

 private:
  std::string place_;
  std::map<std::string, std::size_t> seen_;
};

/// The objects of an array. Throws for more than kMaximumObjects.
std::vector<JsonFields> mapObjects(const JsonFields& map, const char* name);

double readBeat(const JsonFields& object, const char* name);
/// How long a wall lasts, in beats.
double readWallBeats(const JsonFields& object, const char* name);
double readColumn(const JsonFields& object, const char* name);
double readRow(const JsonFields& object, const char* name);
CutDirection readCut(const JsonFields& object, const char* name);
Hand readHand(const JsonFields& object, const char* name);
/// Sizes and places of walls, which may lie beyond the grid.
Wall readWall(const JsonFields& object, const char* column, const char* row, const char* width,
              const char* height);
/// The same without row and height.
Wall readWallColumns(const JsonFields& object, const char* column, const char* width);
/// From 1 to 100,000.
double readTempo(const JsonFields& object, const char* name);
/// Slices and squish of a chain; its places and times are set before.
void readLinks(const JsonFields& object, const char* slices, Chain& chain);
/// Throws unless the number is 0: lanes that turn about the player are not played.
void expectNoRotation(const JsonFields& object, const char* name);

Beatmap readVersion2(const JsonFields& map, UnknownFields& unknown);
Beatmap readVersion3(const JsonFields& map, UnknownFields& unknown);
Beatmap readVersion4(const JsonFields& map, UnknownFields& unknown);

}  // namespace sim2vr::games::beats

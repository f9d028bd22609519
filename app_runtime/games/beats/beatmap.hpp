// SPDX-License-Identifier: Apache-2.0
// One difficulty of a map as it is written, in beats; the three versions of the format have become
// the same.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "beats/level.hpp"
#include "beats/tempo.hpp"

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

}  // namespace sim2vr::games::beats

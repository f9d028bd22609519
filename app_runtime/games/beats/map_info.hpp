// SPDX-License-Identifier: Apache-2.0
// Info.dat: what a map offers, and how fast its boxes come.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats {

struct MapDifficulty {
  std::string characteristic = {};
  std::string difficulty = {};
  std::string file = {};
  /// Note jump speed; 0 means the difficulty's usual one.
  double speed_mps = 0.0;
  /// Note jump start offset.
  double offset_beats = 0.0;
  /// Why it cannot be played; thrown when it is chosen.
  std::optional<InvalidArgument> problem = {};
};

struct MapInfo {
  std::string title;
  double beats_per_minute = 120.0;
  /// Of version 4: length of the music; 0 where it is not given.
  double song_s = 0.0;
  /// Of version 4: where its tempo is; may be empty.
  std::string audio_file;
  std::vector<MapDifficulty> difficulties;
};

/// Reads an Info.dat of version 2 or 4. `place` names it in errors. Throws InvalidArgument naming
/// file, object and field; the problem of a single difficulty is kept with that difficulty.
MapInfo readMapInfo(std::string_view json, const std::string& place);

/// The difficulties that are meant: one for a name, in any case, "Expert+" or "ExpertPlus"; without
/// a name all of the characteristic, the hardest first. Without a characteristic those of
/// "Standard", or else of the only one. Throws InvalidArgument that lists what the map offers.
std::vector<MapDifficulty> matchingDifficulties(const MapInfo& info,
                                                const std::string& characteristic,
                                                const std::string& difficulty);

/// Speed of approach: the map's own, or the difficulty's usual one where the map says 0.
double jumpSpeed_mps(const MapDifficulty& difficulty);

/// Half jump duration in seconds: 4 beats, halved as long as a box would come from further than
/// 17.999 m, and the offset, but at least a quarter of a beat (the game's formula, as the mapping
/// community has published it).
double approachSeconds(double speed_mps, double offset_beats, double beats_per_minute);

}  // namespace sim2vr::games::beats

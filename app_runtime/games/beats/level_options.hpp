// SPDX-License-Identifier: Apache-2.0
// From a round's options to its level.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>

#include "beats/level.hpp"
#include "beats/level_generator.hpp"
#include "beats/map_files.hpp"
#include "sim2vr/core/options.hpp"

namespace sim2vr::games::beats {

// The levels that come with the game.

/// Ten seconds with four boxes, one at a time on alternating sides, cut along the diagonals; no
/// walls, no mines: what the paper's users play.
Level firstLevel();

/// A minute of our own with boxes, walls and mines: the map in levels/full.
std::shared_ptr<const Level> fullLevel();

/// The files of levels/full, which the build puts into the library.
const std::map<std::string, std::string>& fullMap();

// From the files of a map to a level.

/// Reads one difficulty of a map; its names as in matchingDifficulties. Throws InvalidArgument
/// naming file, object and field, or the option.
Level readMapLevel(const MapFiles& files, const std::string& characteristic,
                   const std::string& difficulty);

/// Reads a level from a folder with Info.dat, a zipped one, or a single difficulty (.dat or .json),
/// which takes tempo and speed from the Info.dat beside it that lists it. Without one the tempo is
/// the file's own at beat 0, the speed 10 m/s. Throws as readMapLevel does.
Level loadLevel(const std::string& path, const std::string& characteristic,
                const std::string& difficulty);

/// What the options say of the level. A level of a file is read with them, so that what is wrong
/// with it is said before a round begins.
struct LevelSettings {
  /// "first", "full", "generated" or the path of a map.
  std::string level = "first";
  /// Of maps: which of their difficulties.
  std::string difficulty = {};
  std::string characteristic = {};
  GeneratorSettings generator = {};
  /// Speed of approach and twice the way from appearing to the cut plane; 0: the level's.
  double approach_mps = 0.0;
  double jump_distance_m = 0.0;
  /// "full", or what the file held; none for levels that are made when they are played.
  std::shared_ptr<const Level> loaded = nullptr;
};

/// Reads the options `level`, `difficulty`, `characteristic`, those of the approach and the
/// generator's (docs/reference/games/beats_levels.md); the generator's serve "generated" alone.
/// Throws InvalidArgument naming the option, or the file, object and field that cannot be used.
LevelSettings readLevelSettings(Options& options);

/// The level to play. Same settings and seed, same bits; the seed matters to "generated" alone.
Level makeLevel(const LevelSettings& settings, std::uint32_t seed);

}  // namespace sim2vr::games::beats

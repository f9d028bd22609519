// SPDX-License-Identifier: Apache-2.0
// The files of a map, wherever they lie: in a folder, in a zip archive, in memory.
#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats {

/// A file of a map is not larger than this, unpacked.
inline constexpr std::size_t kMaximumMapFileBytes = std::size_t{64} << 20U;
/// An archive, which holds music and pictures, too.
inline constexpr std::size_t kMaximumArchiveBytes = std::size_t{512} << 20U;

class MapFiles {
 public:
  MapFiles() = default;
  virtual ~MapFiles() = default;
  MapFiles(const MapFiles&) = delete;
  MapFiles& operator=(const MapFiles&) = delete;

  /// How errors name the whole.
  virtual std::string where() const = 0;
  /// Names of the files, without folders.
  virtual std::vector<std::string> names() const = 0;
  /// The bytes of one of names(). Throws InvalidArgument.
  virtual std::string read(const std::string& name) const = 0;

  /// The one of names() that is `name` in any case (the game is at home on systems where case does
  /// not matter); empty when there is none.
  std::string find(std::string_view name) const;
  /// How errors name a file of it.
  std::string place(const std::string& name) const { return where() + ": " + name; }
};

/// Files that are in memory already.
class MemoryFiles final : public MapFiles {
 public:
  MemoryFiles(std::map<std::string, std::string> files, std::string where)
      : files_(std::move(files)), where_(std::move(where)) {}

  std::string where() const override { return where_; }
  std::vector<std::string> names() const override;
  std::string read(const std::string& name) const override { return files_.at(name); }

 private:
  std::map<std::string, std::string> files_;
  std::string where_;
};

/// The files directly in a folder. Throws InvalidArgument when it cannot be listed.
std::unique_ptr<MapFiles> filesOfFolder(const std::filesystem::path& folder);

/// The files beside Info.dat in a zip archive, which may lie in a folder of it. Nothing is written
/// to the disk. Throws InvalidArgument for bytes that are no archive, for one without Info.dat, and
/// for entries that would lead out of it.
std::unique_ptr<MapFiles> filesOfZip(std::string bytes, const std::string& where);

/// The bytes of a file. Throws InvalidArgument ("where") when it cannot be read or is larger.
std::string readBytes(const std::filesystem::path& path, std::size_t maximum_bytes);

// Info.dat: what a map offers, and how fast its boxes come.

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

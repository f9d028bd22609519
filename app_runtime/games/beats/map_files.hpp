// SPDX-License-Identifier: Apache-2.0
// The files of a map, wherever they lie: in a folder, in a zip archive, in memory.
#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

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

}  // namespace sim2vr::games::beats

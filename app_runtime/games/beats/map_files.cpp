// SPDX-License-Identifier: Apache-2.0
#include "beats/map_files.hpp"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <iterator>
#include <system_error>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats {
namespace {

namespace fs = std::filesystem;

/// A folder with more is no map.
constexpr std::size_t kMaximumFiles = 100'000;

std::string inLowerCase(std::string_view text) {
  std::string lower(text);
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char letter) { return static_cast<char>(std::tolower(letter)); });
  return lower;
}

class FolderFiles final : public MapFiles {
 public:
  explicit FolderFiles(fs::path folder) : folder_(std::move(folder)) {
    std::error_code error;
    for (fs::directory_iterator entry(folder_, error), end; !error && entry != end;
         entry.increment(error)) {
      if (names_.size() == kMaximumFiles) {
        throw InvalidArgument(where(), "a folder with more files",
                              std::to_string(kMaximumFiles) + " at most");
      }
      if (entry->is_regular_file(error)) names_.push_back(entry->path().filename().string());
    }
    if (error) throw InvalidArgument(where(), error.message(), "a folder that can be listed");
    std::sort(names_.begin(), names_.end());
  }

  std::string where() const override { return folder_.string(); }
  std::vector<std::string> names() const override { return names_; }
  std::string read(const std::string& name) const override {
    return readBytes(folder_ / name, kMaximumMapFileBytes);
  }

 private:
  fs::path folder_;
  std::vector<std::string> names_;
};

}  // namespace

std::string MapFiles::find(std::string_view name) const {
  const std::vector<std::string> all = names();
  const auto exact = std::find(all.begin(), all.end(), name);
  if (exact != all.end()) return *exact;
  const std::string wanted = inLowerCase(name);
  const auto found = std::find_if(all.begin(), all.end(), [&](const std::string& candidate) {
    return inLowerCase(candidate) == wanted;
  });
  return found == all.end() ? "" : *found;
}

std::vector<std::string> MemoryFiles::names() const {
  std::vector<std::string> found;
  for (const auto& [name, bytes] : files_) found.push_back(name);
  return found;
}

std::unique_ptr<MapFiles> filesOfFolder(const fs::path& folder) {
  return std::make_unique<FolderFiles>(folder);
}

std::string readBytes(const fs::path& path, std::size_t maximum_bytes) {
  std::error_code error;
  std::ifstream file;
  if (fs::is_regular_file(path, error)) file.open(path, std::ios::binary);
  if (!file.is_open())
    throw InvalidArgument(path.string(), "no readable file", "a file that can be read");
  std::string bytes;
  std::string block(std::size_t{1} << 16U, '\0');
  while (file.read(block.data(), static_cast<std::streamsize>(block.size())) || file.gcount() > 0) {
    bytes.append(block, 0, static_cast<std::size_t>(file.gcount()));
    if (bytes.size() > maximum_bytes) {
      throw InvalidArgument(path.string(), "a larger file",
                            std::to_string(maximum_bytes >> 20U) + " MiB at most");
    }
  }
  if (file.bad()) throw InvalidArgument(path.string(), "a read error", "a file that can be read");
  return bytes;
}

}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
// The only user of libzip.
#include <zip.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <string>

#include "beats/map_files.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr zip_int64_t kMaximumEntries = 10'000;

struct CloseZip {
  void operator()(zip_t* zip) const { zip_discard(zip); }
};
struct CloseEntry {
  void operator()(zip_file_t* entry) const { zip_fclose(entry); }
};

bool isInfo(std::string_view name) {
  constexpr std::string_view kInfo = "info.dat";
  return std::equal(name.begin(), name.end(), kInfo.begin(), kInfo.end(),
                    [](unsigned char a, char b) { return std::tolower(a) == b; });
}

/// Folder with its slash, empty at the top, and the name behind it.
std::pair<std::string, std::string> split(std::string path) {
  std::replace(path.begin(), path.end(), '\\', '/');
  const std::size_t slash = path.rfind('/');
  if (slash == std::string::npos) return {"", path};
  return {path.substr(0, slash + 1), path.substr(slash + 1)};
}

bool leadsOut(const std::string& folder) {
  const bool drive = folder.find(':') != std::string::npos;
  return drive || folder.starts_with("/") || folder.starts_with("../") ||
         folder.find("/../") != std::string::npos;
}

class ZipFiles final : public MapFiles {
 public:
  ZipFiles(std::string bytes, std::string where)
      : bytes_(std::move(bytes)), where_(std::move(where)) {
    open();
    list();
  }

  std::string where() const override { return where_; }

  std::vector<std::string> names() const override {
    std::vector<std::string> found;
    for (const auto& [name, index] : entries_) found.push_back(name);
    return found;
  }

  std::string read(const std::string& name) const override {
    const auto entry = entries_.find(name);
    if (entry == entries_.end()) throw InvalidArgument(place(name), "no such entry", "an entry");
    const std::unique_ptr<zip_file_t, CloseEntry> file(
        zip_fopen_index(zip_.get(), entry->second, 0));
    if (!file) refuse(name, zip_strerror(zip_.get()));
    // What the directory says of an entry's size need not be true.
    std::string bytes;
    std::string block(std::size_t{1} << 16U, '\0');
    while (true) {
      const zip_int64_t count = zip_fread(file.get(), block.data(), block.size());
      if (count < 0) refuse(name, zip_file_strerror(file.get()));
      if (count == 0) return bytes;
      bytes.append(block, 0, static_cast<std::size_t>(count));
      if (bytes.size() > kMaximumMapFileBytes) {
        throw InvalidArgument(place(name), "a larger file",
                              std::to_string(kMaximumMapFileBytes >> 20U) + " MiB at most");
      }
    }
  }

 private:
  [[noreturn]] void refuse(const std::string& name, const std::string& problem) const {
    throw InvalidArgument(place(name), "an entry that cannot be unpacked (" + problem + ")",
                          "a stored or deflated one without a password");
  }

  void open() {
    zip_error_t error;
    zip_error_init(&error);
    zip_source_t* source = zip_source_buffer_create(bytes_.data(), bytes_.size(), 0, &error);
    zip_t* opened = source == nullptr ? nullptr : zip_open_from_source(source, ZIP_RDONLY, &error);
    const std::string problem = opened == nullptr ? zip_error_strerror(&error) : "";
    if (opened == nullptr) zip_source_free(source);
    zip_error_fini(&error);
    zip_.reset(opened);
    if (!zip_) throw InvalidArgument(where_, "no zip archive (" + problem + ")", "a zipped map");
  }

  void list() {
    const zip_int64_t count = zip_get_num_entries(zip_.get(), 0);
    if (count > kMaximumEntries) {
      throw InvalidArgument(where_, std::to_string(count) + " entries",
                            std::to_string(kMaximumEntries) + " at most");
    }
    std::map<std::string, std::map<std::string, zip_uint64_t>> folders;
    for (zip_int64_t i = 0; i < count; ++i) {
      const auto index = static_cast<zip_uint64_t>(i);
      const char* name = zip_get_name(zip_.get(), index, ZIP_FL_ENC_GUESS);
      if (name == nullptr) continue;
      const auto [folder, file] = split(name);
      if (leadsOut(folder)) {
        throw InvalidArgument(where_, "the entry '" + std::string(name) + "'",
                              "entries that stay in the archive");
      }
      if (!file.empty()) folders[folder].emplace(file, index);
    }
    choose(folders);
  }

  /// The folder with Info.dat that lies nearest to the top.
  void choose(const std::map<std::string, std::map<std::string, zip_uint64_t>>& folders) {
    std::ptrdiff_t best = -1;
    for (const auto& [folder, files] : folders) {
      const bool has_info = std::any_of(files.begin(), files.end(),
                                        [](const auto& file) { return isInfo(file.first); });
      const std::ptrdiff_t depth = std::count(folder.begin(), folder.end(), '/');
      if (!has_info || (best >= 0 && depth >= best)) continue;
      best = depth;
      entries_ = files;
    }
    if (best < 0) throw InvalidArgument(where_, "no Info.dat in it", "a map with its Info.dat");
  }

  std::string bytes_;
  std::string where_;
  std::unique_ptr<zip_t, CloseZip> zip_;
  std::map<std::string, zip_uint64_t> entries_;
};

}  // namespace

std::unique_ptr<MapFiles> filesOfZip(std::string bytes, const std::string& where) {
  return std::make_unique<ZipFiles>(std::move(bytes), where);
}

}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
#include "beats/map_files.hpp"

#include <zip.h>
#include <algorithm>
#include <cctype>
#include <fstream>
#include <iterator>
#include <system_error>

#include "beats/beatmap.hpp"

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

constexpr std::size_t kMaximumDifficulties = 200;

/// Lower case, "expert+" spelt out.
std::string folded(std::string_view name) {
  std::string text;
  for (const char letter : name) {
    if (letter == '+') {
      text += "plus";
    } else {
      text += static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
    }
  }
  return text;
}

/// The name of a file beside Info.dat. A map from outside must not name others.
std::string fileName(const JsonFields& object, const char* field) {
  object.expect(field, "the name of a file beside Info.dat");
  std::string name = object.text(field, "");
  const bool leads_away = name.find_first_of("/\\:") != std::string::npos || name == "." ||
                          name == ".." || name.find('\0') != std::string::npos;
  if (name.empty() || leads_away) {
    throw InvalidArgument(object.path(field), "'" + name + "'",
                          "the name of a file beside Info.dat, without a folder");
  }
  return name;
}

/// Modifications of the game that put things elsewhere than the formats say.
void expectPlainPlaces(const JsonFields& difficulty, const char* custom, const char* requirements) {
  const auto data = difficulty.object(custom);
  if (!data) return;
  for (const std::string& name : data->texts(requirements)) {
    if (name != "Noodle Extensions" && name != "Mapping Extensions") continue;
    throw InvalidArgument(data->path(requirements), "'" + name + "'",
                          "a difficulty without it: the places of its boxes are not the formats'");
  }
}

/// 0: the difficulty's usual one.
double readSpeed(const JsonFields& object, const char* name) {
  const double speed_mps = object.number(name, 0.0);
  return speed_mps == 0.0 ? 0.0 : object.number(name, 0.0, 1.0, 1000.0);
}

double readOffset(const JsonFields& object, const char* name) {
  return object.number(name, 0.0, -100.0, 100.0);
}

/// How a version of Info.dat names the fields of a difficulty.
struct EntryFields {
  const char* difficulty;
  const char* file;
  const char* speed;
  const char* offset;
  const char* custom;
  const char* requirements;
};
constexpr EntryFields kFields2{
    "_difficulty", "_beatmapFilename", "_noteJumpMovementSpeed", "_noteJumpStartBeatOffset",
    "_customData", "_requirements"};
constexpr EntryFields kFields4{
    "difficulty", "beatmapDataFilename", "noteJumpMovementSpeed", "noteJumpStartBeatOffset",
    "customData", "requirements"};

/// The name must be readable; every other problem matters to those alone who play it.
MapDifficulty readEntry(const JsonFields& entry, const std::string& characteristic,
                        const EntryFields& fields) {
  MapDifficulty read{.characteristic = characteristic,
                     .difficulty = entry.text(fields.difficulty, "")};
  try {
    read.file = fileName(entry, fields.file);
    read.speed_mps = readSpeed(entry, fields.speed);
    read.offset_beats = readOffset(entry, fields.offset);
    expectPlainPlaces(entry, fields.custom, fields.requirements);
  } catch (const InvalidArgument& problem) {
    read.problem = problem;
  }
  return read;
}

MapInfo readInfo2(const JsonFields& info, UnknownFields& unknown) {
  unknown.look(info, "",
               {"_version", "_songName", "_songSubName", "_songAuthorName", "_levelAuthorName",
                "_beatsPerMinute", "_songTimeOffset", "_shuffle", "_shufflePeriod",
                "_previewStartTime", "_previewDuration", "_songFilename", "_coverImageFilename",
                "_environmentName", "_allDirectionsEnvironmentName", "_environmentNames",
                "_colorSchemes", "_difficultyBeatmapSets"});
  MapInfo read;
  read.title = info.text("_songName", "");
  read.beats_per_minute = readTempo(info, "_beatsPerMinute");
  for (const JsonFields& set : mapObjects(info, "_difficultyBeatmapSets")) {
    set.expect("_beatmapCharacteristicName", "a characteristic such as 'Standard'");
    for (const JsonFields& difficulty : mapObjects(set, "_difficultyBeatmaps")) {
      unknown.look(difficulty, "_difficultyBeatmaps",
                   {"_difficulty", "_difficultyRank", "_beatmapFilename", "_noteJumpMovementSpeed",
                    "_noteJumpStartBeatOffset", "_beatmapColorSchemeIdx", "_environmentNameIdx"});
      difficulty.expect("_difficulty", "a difficulty such as 'Easy'");
      read.difficulties.push_back(
          readEntry(difficulty, set.text("_beatmapCharacteristicName", ""), kFields2));
    }
  }
  return read;
}

MapInfo readInfo4(const JsonFields& info, UnknownFields& unknown) {
  unknown.look(info, "",
               {"version", "song", "audio", "songPreviewFilename", "coverImageFilename",
                "environmentNames", "colorSchemes", "difficultyBeatmaps"});
  MapInfo read;
  if (const auto song = info.object("song")) read.title = song->text("title", "");
  info.expect("audio", "an object with 'bpm'");
  const JsonFields audio = *info.object("audio");
  read.beats_per_minute = readTempo(audio, "bpm");
  read.song_s = audio.number("songDuration", 0.0, 0.0, 1e6);
  if (!audio.text("audioDataFilename", "").empty()) {
    read.audio_file = fileName(audio, "audioDataFilename");
  }
  for (const JsonFields& difficulty : mapObjects(info, "difficultyBeatmaps")) {
    unknown.look(difficulty, "difficultyBeatmaps",
                 {"characteristic", "difficulty", "beatmapAuthors", "environmentNameIdx",
                  "beatmapColorSchemeIdx", "noteJumpMovementSpeed", "noteJumpStartBeatOffset",
                  "beatmapDataFilename", "lightshowDataFilename"});
    difficulty.expect("characteristic", "a characteristic such as 'Standard'");
    difficulty.expect("difficulty", "a difficulty such as 'Easy'");
    read.difficulties.push_back(
        readEntry(difficulty, difficulty.text("characteristic", ""), kFields4));
  }
  return read;
}

/// Every characteristic once, in the map's order.
std::vector<std::string> characteristics(const MapInfo& info) {
  std::vector<std::string> names;
  for (const MapDifficulty& offered : info.difficulties) {
    if (std::find(names.begin(), names.end(), offered.characteristic) == names.end()) {
      names.push_back(offered.characteristic);
    }
  }
  return names;
}

/// Harder ones have higher ranks; names that the game does not have come last.
std::ptrdiff_t rank(const MapDifficulty& difficulty) {
  static const std::vector<std::string> kRanks{"easy", "normal", "hard", "expert", "expertplus"};
  const auto found = std::find(kRanks.begin(), kRanks.end(), folded(difficulty.difficulty));
  return found == kRanks.end() ? -1 : found - kRanks.begin();
}

std::string got(const std::string& name) { return name.empty() ? "none" : "'" + name + "'"; }

std::string chooseCharacteristic(const MapInfo& info, const std::string& wanted) {
  const std::vector<std::string> names = characteristics(info);
  const std::string meant = wanted.empty() ? "Standard" : wanted;
  for (const std::string& name : names) {
    if (folded(name) == folded(meant)) return name;
  }
  if (wanted.empty() && names.size() == 1) return names.front();
  throw InvalidArgument("option 'characteristic'", got(wanted), oneOf(names, wanted));
}

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

// The only user of libzip.

std::unique_ptr<MapFiles> filesOfZip(std::string bytes, const std::string& where) {
  return std::make_unique<ZipFiles>(std::move(bytes), where);
}

MapInfo readMapInfo(std::string_view text, const std::string& place) {
  const nlohmann::json json = parseJson(text, place, kMaximumMapValues);
  const JsonFields info(json, place);
  const bool old = info.has("_version");
  const char* field = old ? "_version" : "version";
  const std::string version = info.text(field, "");
  UnknownFields unknown(place);
  MapInfo read;
  if (old && version.starts_with("2.")) {
    read = readInfo2(info, unknown);
  } else if (!old && version.starts_with("4.")) {
    read = readInfo4(info, unknown);
  } else {
    throw InvalidArgument(info.path(field), got(version), "an Info.dat of version 2 or 4");
  }
  if (read.difficulties.empty() || read.difficulties.size() > kMaximumDifficulties) {
    throw InvalidArgument(place, std::to_string(read.difficulties.size()) + " difficulties",
                          "1 to " + std::to_string(kMaximumDifficulties));
  }
  unknown.warn();
  return read;
}

std::vector<MapDifficulty> matchingDifficulties(const MapInfo& info,
                                                const std::string& characteristic,
                                                const std::string& difficulty) {
  const std::string set = chooseCharacteristic(info, characteristic);
  std::vector<std::string> names;
  std::vector<MapDifficulty> all;
  for (const MapDifficulty& offered : info.difficulties) {
    if (offered.characteristic != set) continue;
    if (folded(offered.difficulty) == folded(difficulty)) return {offered};
    names.push_back(offered.difficulty);
    all.push_back(offered);
  }
  if (!difficulty.empty()) {
    throw InvalidArgument("option 'difficulty'", got(difficulty),
                          oneOf(names, difficulty) + " (of the characteristic '" + set + "')");
  }
  std::stable_sort(all.begin(), all.end(), [](const MapDifficulty& a, const MapDifficulty& b) {
    return rank(a) > rank(b);
  });
  return all;
}

double jumpSpeed_mps(const MapDifficulty& difficulty) {
  if (difficulty.speed_mps > 0.0) return difficulty.speed_mps;
  const std::string name = folded(difficulty.difficulty);
  if (name == "expertplus") return 16.0;
  return name == "expert" ? 12.0 : 10.0;
}

double approachSeconds(double speed_mps, double offset_beats, double beats_per_minute) {
  constexpr double kFurthest_m = 17.999;
  constexpr double kFewestBeats = 0.25;
  const double beat_s = 60.0 / beats_per_minute;
  double beats = 4.0;
  while (speed_mps * beat_s * beats > kFurthest_m) beats /= 2.0;
  return std::max(beats + offset_beats, kFewestBeats) * beat_s;
}

}  // namespace sim2vr::games::beats

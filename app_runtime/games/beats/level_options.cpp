// SPDX-License-Identifier: Apache-2.0
#include "beats/level_options.hpp"

#include <algorithm>
#include <array>
#include <filesystem>
#include <optional>
#include <vector>

#include "beats/beatmap.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/text.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr double kSameTime_s = 1e-3;

bool isThere(const Box& head, const std::vector<Box>& boxes) {
  auto box = std::lower_bound(
      boxes.begin(), boxes.end(), head.time_s - kSameTime_s,
      [](const Box& candidate, double time_s) { return candidate.time_s < time_s; });
  for (; box != boxes.end() && box->time_s <= head.time_s + kSameTime_s; ++box) {
    if (box->hand == head.hand && box->column == head.column && box->row == head.row) return true;
  }
  return false;
}

/// The boxes of a chain: its head, unless `boxes`, in order of time, have it already, and its
/// links: Box::link, any direction, evenly spread in time up to the tail, on the game's curve. That
/// is a quadratic Bezier curve from head to tail whose middle point lies half their distance from
/// the head in its cut direction (down for kAny).
std::vector<Box> chainBoxes(const Chain& chain, double head_s, double tail_s,
                            const std::vector<Box>& boxes) {
  std::vector<Box> added;
  Box head = chain.head;
  head.time_s = head_s;
  if (head.cut == CutDirection::kAny) head.cut = CutDirection::kDown;
  if (!isThere(head, boxes)) added.push_back(head);
  const Eigen::Vector2d begin(head.column, head.row);
  const Eigen::Vector2d end(chain.tail_column, chain.tail_row);
  const Eigen::Vector2d middle = begin + cutVector(head) * (end - begin).norm() / 2.0;
  for (int i = 1; i < chain.slices; ++i) {
    const double share = static_cast<double>(i) / (chain.slices - 1);
    const double t = share * chain.squish;
    const Eigen::Vector2d place =
        (1.0 - t) * (1.0 - t) * begin + 2.0 * (1.0 - t) * t * middle + t * t * end;
    Box link{head_s + share * (tail_s - head_s), place.x(), place.y(), head.hand};
    link.link = true;
    added.push_back(link);
  }
  return added;
}

namespace fs = std::filesystem;

constexpr double kLongest_s = 4.0 * 3600.0;
/// Play goes on for so long behind the last thing, where the map does not tell the music's length.
constexpr double kEnding_s = 1.0;
constexpr double kUsualSpeed_mps = 10.0;
constexpr const char* kInfoFile = "Info.dat";

/// Files as they are read, for the hash: the same map has the same one in a folder and zipped.
class Reading {
 public:
  explicit Reading(const MapFiles& files) : files_(files) {}

  std::string read(const std::string& name, const std::string& who_asks) {
    const std::string found = files_.find(name);
    if (found.empty()) {
      throw InvalidArgument(files_.place(name), "no such file",
                            "the file that " + who_asks + " names");
    }
    std::string bytes = files_.read(found);
    read_ += bytes + '\0';
    return bytes;
  }
  std::string place(const std::string& name) const {
    const std::string found = files_.find(name);
    return files_.place(found.empty() ? name : found);
  }
  std::string hash() const { return bytesHash(read_); }

 private:
  const MapFiles& files_;
  std::string read_;
};

template <class Things>
void sortByTime(Things& things) {
  std::stable_sort(things.begin(), things.end(),
                   [](const auto& a, const auto& b) { return a.time_s < b.time_s; });
}

void addTempo(const TempoMap& tempo, Level& level) {
  level.beats_per_minute = tempo.beatsPerMinuteAt(0.0);
  for (const TempoMap::Piece& piece : tempo.pieces()) {
    if (piece.beat > 0.0) {
      level.tempo_changes.push_back({tempo.seconds(piece.beat), 60.0 / piece.beat_s});
    }
  }
}

void addChains(const std::vector<Chain>& chains, const TempoMap& tempo, const std::string& place,
               Level& level) {
  std::vector<Box> all;
  for (const Chain& chain : chains) {
    const std::vector<Box> boxes =
        chainBoxes(chain, tempo.seconds(chain.beat), tempo.seconds(chain.tail_beat), level.boxes);
    all.insert(all.end(), boxes.begin(), boxes.end());
    if (all.size() > kMaximumObjects) {
      throw InvalidArgument(place + ": links of chains", "more",
                            std::to_string(kMaximumObjects) + " at most");
    }
  }
  level.boxes.insert(level.boxes.end(), all.begin(), all.end());
  sortByTime(level.boxes);
}

void addObjects(const Beatmap& beatmap, const TempoMap& tempo, const std::string& place,
                Level& level) {
  for (const auto& [beat, box] : beatmap.boxes) {
    level.boxes.push_back(box);
    level.boxes.back().time_s = tempo.seconds(beat);
  }
  for (const auto& [beat, mine] : beatmap.mines) {
    level.mines.push_back(mine);
    level.mines.back().time_s = tempo.seconds(beat);
  }
  for (const auto& [beat, beats, wall] : beatmap.walls) {
    level.walls.push_back(wall);
    level.walls.back().time_s = tempo.seconds(beat);
    level.walls.back().duration_s = tempo.seconds(beat + beats) - tempo.seconds(beat);
  }
  sortByTime(level.boxes);
  sortByTime(level.mines);
  sortByTime(level.walls);
  addChains(beatmap.chains, tempo, place, level);
}

double endOf(const Level& level) {
  double end_s = 0.0;
  for (const Box& box : level.boxes) end_s = std::max(end_s, box.time_s);
  for (const Mine& mine : level.mines) end_s = std::max(end_s, mine.time_s);
  for (const Wall& wall : level.walls) end_s = std::max(end_s, wall.time_s + wall.duration_s);
  return end_s + kEnding_s;
}

Level makeLevel(const Beatmap& beatmap, const TempoMap& tempo, const std::string& place,
                double song_s) {
  Level level;
  addTempo(tempo, level);
  addObjects(beatmap, tempo, place, level);
  level.length_s = std::max(endOf(level), song_s);
  if (level.boxes.empty()) throw InvalidArgument(place, "no boxes", "boxes to cut");
  if (!(level.length_s <= kLongest_s)) {
    throw InvalidArgument(place, std::to_string(level.length_s) + " s of play", "4 hours at most");
  }
  return level;
}

TempoMap readTempoMap(const Beatmap& beatmap, const MapInfo& info, Reading& reading) {
  if (beatmap.version < 4) return {info.beats_per_minute, beatmap.tempo_changes};
  if (!info.audio_file.empty()) {
    const auto regions =
        readRegions(reading.read(info.audio_file, kInfoFile), reading.place(info.audio_file));
    if (!regions.empty()) return TempoMap(regions);
  }
  return {info.beats_per_minute, {}};
}

Level readDifficulty(const MapInfo& info, const MapDifficulty& chosen, Reading reading) {
  if (chosen.problem) throw InvalidArgument(*chosen.problem);
  const std::string place = reading.place(chosen.file);
  const Beatmap beatmap = readBeatmap(reading.read(chosen.file, kInfoFile), place);
  Level level = makeLevel(beatmap, readTempoMap(beatmap, info, reading), place, info.song_s);
  level.name = info.title + " (" + chosen.difficulty + ")";
  level.speed_mps = jumpSpeed_mps(chosen);
  level.approach_s = approachSeconds(level.speed_mps, chosen.offset_beats, info.beats_per_minute);
  level.hash = reading.hash();
  return level;
}

std::string listed(const std::vector<MapDifficulty>& difficulties) {
  std::vector<std::string> names;
  for (const MapDifficulty& each : difficulties) names.push_back(each.difficulty);
  return listChoices(names);
}

/// The first that can be played; the first one's problem when none can.
Level readHardest(const MapInfo& info, const std::vector<MapDifficulty>& hardest_first,
                  const Reading& reading, const std::string& where) {
  std::optional<InvalidArgument> problem;
  for (const MapDifficulty& candidate : hardest_first) {
    try {
      Level level = readDifficulty(info, candidate, reading);
      if (hardest_first.size() > 1) {
        warnOnce(where + ": no difficulty given, '" + candidate.difficulty +
                 "' is the hardest that can be played of " + listed(hardest_first));
      }
      return level;
    } catch (const InvalidArgument& error) {
      if (!problem) problem = error;
    }
  }
  throw InvalidArgument(*problem);
}

MapInfo readInfo(const MapFiles& files, Reading& reading) {
  if (!files.find(kInfoFile).empty()) {
    return readMapInfo(reading.read(kInfoFile, ""), reading.place(kInfoFile));
  }
  const bool first_version = !files.find("info.json").empty();
  throw InvalidArgument(
      files.where(), first_version ? "a map of version 1, with info.json" : "no Info.dat in it",
      first_version ? "one of version 2, 3 or 4, with Info.dat" : "a map with its Info.dat");
}

/// A difficulty that no Info.dat lists.
Level readAlone(const fs::path& path, const std::string& text) {
  const Beatmap beatmap = readBeatmap(text, path.string());
  if (beatmap.tempo_changes.empty() || beatmap.tempo_changes.front().beat > 0.0) {
    throw InvalidArgument(path.string(), "a difficulty without tempo",
                          "an Info.dat beside it that lists it, or its own tempo at beat 0");
  }
  const TempoMap tempo(beatmap.tempo_changes.front().beats_per_minute, beatmap.tempo_changes);
  Level level = makeLevel(beatmap, tempo, path.string(), 0.0);
  level.name = path.stem().string();
  level.speed_mps = kUsualSpeed_mps;
  level.approach_s = approachSeconds(level.speed_mps, 0.0, level.beats_per_minute);
  level.hash = bytesHash(text);
  return level;
}

fs::path folderOf(const fs::path& file) {
  return file.parent_path().empty() ? fs::path(".") : file.parent_path();
}

/// Whether a file of a map has things to play. Info.dat, and files of lights, tempo and music, have
/// not: who names one of them means the map.
bool isDifficulty(std::string_view text, const std::string& place) {
  const nlohmann::json json = parseJson(text, place, kMaximumMapValues);
  return json.contains("_notes") || json.contains("colorNotes");
}

Level loadSingle(const fs::path& path, const std::string& text) {
  const auto files = filesOfFolder(folderOf(path));
  if (files->find(kInfoFile).empty()) return readAlone(path, text);
  Reading reading(*files);
  const MapInfo info = readInfo(*files, reading);
  const std::string name = path.filename().string();
  for (const MapDifficulty& listed : info.difficulties) {
    if (files->find(listed.file) == name) return readDifficulty(info, listed, reading);
  }
  return readAlone(path, text);
}

Level loadFile(const fs::path& path, const std::string& characteristic,
               const std::string& difficulty) {
  const std::string text = readBytes(path, kMaximumMapFileBytes);
  if (!isDifficulty(text, path.string())) {
    const auto files = filesOfFolder(folderOf(path));
    if (files->find(kInfoFile).empty() && files->find("info.json").empty()) {
      throw InvalidArgument(path.string(), "no notes in it",
                            "a difficulty, or a map's folder, archive or Info.dat");
    }
    return readMapLevel(*files, characteristic, difficulty);
  }
  for (const auto& [option, value] :
       {std::pair("characteristic", characteristic), std::pair("difficulty", difficulty)}) {
    if (value.empty()) continue;
    throw InvalidArgument("option '" + std::string(option) + "'",
                          "'" + value + "' with a single difficulty",
                          "none, or the map's folder or archive as the level");
  }
  return loadSingle(path, text);
}

const std::array<std::string, 3> kNames{"first", "full", "generated"};

GeneratorSettings readGenerator(Options& options) {
  GeneratorSettings settings;
  settings.boxes_per_second =
      options.getNumber("boxes_per_second", settings.boxes_per_second, 0.1, 3.0);
  settings.pattern = options.getChoice("pattern", settings.pattern, generatorPatterns());
  settings.speed_mps = options.getNumber("speed_mps", settings.speed_mps, 2.0, 20.0);
  // So that no level is slower than 1 m/s.
  settings.speed_spread_mps =
      options.getNumber("speed_spread_mps", 0.0, 0.0, settings.speed_mps - 1.0);
  settings.walls_per_minute =
      options.getNumber("walls_per_minute", settings.walls_per_minute, 0.0, 15.0);
  settings.mines_per_minute =
      options.getNumber("mines_per_minute", settings.mines_per_minute, 0.0, 60.0);
  settings.seconds = options.getNumber("level_seconds", settings.seconds, 10.0, 600.0);
  return settings;
}

void expectMap(const std::string& path) {
  std::error_code error;
  if (std::filesystem::exists(path, error)) return;
  throw InvalidArgument("option 'level'", "'" + path + "'",
                        listChoices(kNames) + ", or the path of a map" + didYouMean(path, kNames));
}

Level levelOf(const LevelSettings& settings, std::uint32_t seed) {
  if (settings.loaded != nullptr) return *settings.loaded;
  return settings.level == "generated" ? generateLevel(settings.generator, seed) : firstLevel();
}

}  // namespace

Level firstLevel() {
  // Inwards and down, then back the way the blade came: a stroke begins where the last one ended.
  constexpr double kRow = 1.0;
  Level level;
  level.name = "first";
  level.length_s = 10.0;
  level.beats_per_minute = 100.0;
  // Slow, as first levels are: a box is within the blade's reach for a quarter of a second.
  level.speed_mps = 5.0;
  level.approach_s = 2.0;
  level.boxes = {{2.4, 1.0, kRow, Hand::kLeft, CutDirection::kDownRight},
                 {4.8, 2.0, kRow, Hand::kRight, CutDirection::kDownLeft},
                 {7.2, 1.0, kRow, Hand::kLeft, CutDirection::kUpLeft},
                 {9.6, 2.0, kRow, Hand::kRight, CutDirection::kUpRight}};
  level.hash = contentHash(level);
  return level;
}

std::shared_ptr<const Level> fullLevel() {
  static const auto level = [] {
    Level read = readMapLevel(MemoryFiles(fullMap(), "level 'full'"), "", "");
    read.name = "full";
    return std::make_shared<const Level>(std::move(read));
  }();
  return level;
}

Level readMapLevel(const MapFiles& files, const std::string& characteristic,
                   const std::string& difficulty) {
  Reading reading(files);
  const MapInfo info = readInfo(files, reading);
  return readHardest(info, matchingDifficulties(info, characteristic, difficulty), reading,
                     files.where());
}

Level loadLevel(const std::string& path, const std::string& characteristic,
                const std::string& difficulty) {
  std::error_code error;
  if (fs::is_directory(path, error)) {
    return readMapLevel(*filesOfFolder(path), characteristic, difficulty);
  }
  if (fs::path(path).extension() == ".zip") {
    return readMapLevel(*filesOfZip(readBytes(path, kMaximumArchiveBytes), path), characteristic,
                        difficulty);
  }
  return loadFile(path, characteristic, difficulty);
}

LevelSettings readLevelSettings(Options& options) {
  LevelSettings settings;
  settings.level = pathFromUri("option 'level'", options.getString("level", settings.level));
  settings.difficulty = options.getString("difficulty", "");
  settings.characteristic = options.getString("characteristic", "");
  settings.generator = readGenerator(options);
  settings.approach_mps = options.getNumber("approach_mps", 0.0, 0.0, 40.0);
  settings.jump_distance_m = options.getNumber("jump_distance_m", 0.0, 0.0, 100.0);
  if (settings.level == "full") {
    settings.loaded = fullLevel();
  } else if (settings.level != "first" && settings.level != "generated") {
    expectMap(settings.level);
    settings.loaded = std::make_shared<const Level>(
        loadLevel(settings.level, settings.characteristic, settings.difficulty));
  }
  return settings;
}

Level makeLevel(const LevelSettings& settings, std::uint32_t seed) {
  Level level = levelOf(settings, seed);
  if (settings.approach_mps > 0.0) level.speed_mps = settings.approach_mps;
  if (settings.jump_distance_m > 0.0) {
    level.approach_s = settings.jump_distance_m / 2.0 / level.speed_mps;
  }
  return level;
}

}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
#include "beats/map_reader.hpp"

#include <algorithm>
#include <mutex>
#include <set>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/core/text.hpp"

namespace sim2vr::games::beats {
namespace {

/// How far walls may lie beyond the grid, and their largest size, in cells.
constexpr std::int64_t kWallCells = 50;
/// Longer than any song.
constexpr double kMaximumWallBeats = 2000.0;
constexpr std::int64_t kMaximumSlices = 1000;
constexpr std::size_t kShownFields = 6;

bool isCustom(const std::string& name) {
  return name == "customData" || name == "_customData" || name == "_customEvents";
}

}  // namespace

void warnOnce(const std::string& warning) {
  constexpr std::size_t kRemembered = 1000;
  static std::mutex mutex;
  static std::set<std::string> said;
  const std::lock_guard lock(mutex);
  if (said.size() < kRemembered && said.insert(warning).second) {
    logger().warn("{}", validUtf8(warning));
  }
}

void UnknownFields::look(const JsonFields& object, std::string_view kind,
                         std::initializer_list<std::string_view> known) {
  for (const std::string& name : object.names()) {
    if (isCustom(name) || std::find(known.begin(), known.end(), name) != known.end()) continue;
    note(kind.empty() ? name : std::string(kind) + "." + name);
  }
}

void UnknownFields::warn() const {
  if (seen_.empty()) return;
  std::string list;
  std::size_t shown = 0;
  for (const auto& [name, count] : seen_) {
    if (shown++ == kShownFields) break;
    list += (list.empty() ? "'" : ", '") + name + "'";
    if (count > 1) list += " (" + std::to_string(count) + " times)";
  }
  if (seen_.size() > kShownFields) {
    list += " and " + std::to_string(seen_.size() - kShownFields) + " more";
  }
  const std::string warning = place_ + ": unknown or not played: " + list;
  warnOnce(warning);
}

std::vector<JsonFields> mapObjects(const JsonFields& map, const char* name) {
  std::vector<JsonFields> found = map.objects(name);
  if (found.size() > kMaximumObjects) {
    throw InvalidArgument(map.path(name), std::to_string(found.size()) + " objects",
                          std::to_string(kMaximumObjects) + " at most");
  }
  return found;
}

double readBeat(const JsonFields& object, const char* name) {
  return object.number(name, 0.0, 0.0, kMaximumBeat);
}

double readWallBeats(const JsonFields& object, const char* name) {
  return object.number(name, 0.0, 0.0, kMaximumWallBeats);
}

double readColumn(const JsonFields& object, const char* name) {
  return static_cast<double>(object.integer(name, 0, 0, 3));
}

double readRow(const JsonFields& object, const char* name) {
  return static_cast<double>(object.integer(name, 0, 0, 2));
}

CutDirection readCut(const JsonFields& object, const char* name) {
  return static_cast<CutDirection>(
      object.integer(name, 0, 0, static_cast<std::int64_t>(CutDirection::kAny)));
}

Hand readHand(const JsonFields& object, const char* name) {
  return object.integer(name, 0, 0, 1) == 0 ? Hand::kLeft : Hand::kRight;
}

Wall readWallColumns(const JsonFields& object, const char* column, const char* width) {
  Wall wall;
  wall.column = static_cast<double>(object.integer(column, 0, -kWallCells, kWallCells));
  wall.width = static_cast<double>(object.integer(width, 0, 1, kWallCells));
  return wall;
}

Wall readWall(const JsonFields& object, const char* column, const char* row, const char* width,
              const char* height) {
  Wall wall = readWallColumns(object, column, width);
  wall.row = static_cast<double>(object.integer(row, 0, -kWallCells, kWallCells));
  wall.height = static_cast<double>(object.integer(height, 0, 1, kWallCells));
  return wall;
}

double readTempo(const JsonFields& object, const char* name) {
  object.expect(name, "beats per minute");
  return object.number(name, 0.0, 1.0, 100'000.0);
}

void readLinks(const JsonFields& object, const char* slices, Chain& chain) {
  chain.slices = static_cast<int>(object.integer(slices, 1, 1, kMaximumSlices));
  chain.squish = object.number("s", 1.0, 0.0, 10.0);
}

void expectNoRotation(const JsonFields& object, const char* name) {
  const double degrees = object.number(name, 0.0);
  if (degrees == 0.0) return;
  throw InvalidArgument(object.path(name), nlohmann::json(degrees).dump(),
                        "0: lanes that turn about the player are not played");
}

Beatmap readBeatmap(std::string_view text, const std::string& place) {
  const nlohmann::json json = parseJson(text, place, kMaximumMapValues);
  const JsonFields map(json, place);
  // Version 2 has an underscore before its names. Old files do not say their version.
  const bool old = map.has("_version") || map.has("_notes");
  const char* field = old ? "_version" : "version";
  const std::string version = map.text(field, old ? "2.0.0" : "");
  UnknownFields unknown(place);
  Beatmap beatmap;
  if (old && version.starts_with("2.")) {
    beatmap = readVersion2(map, unknown);
  } else if (!old && version.starts_with("3.")) {
    beatmap = readVersion3(map, unknown);
  } else if (!old && version.starts_with("4.")) {
    beatmap = readVersion4(map, unknown);
  } else {
    throw InvalidArgument(map.path(field), version.empty() ? "none" : "'" + version + "'",
                          "a difficulty of version 2, 3 or 4");
  }
  beatmap.version = version[0] - '0';
  std::stable_sort(beatmap.tempo_changes.begin(), beatmap.tempo_changes.end(),
                   [](const auto& a, const auto& b) { return a.beat < b.beat; });
  unknown.warn();
  return beatmap;
}

}  // namespace sim2vr::games::beats

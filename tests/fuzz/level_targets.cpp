// SPDX-License-Identifier: Apache-2.0
// The loader of levels.
#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "beats/level.hpp"
#include "beats/level_options.hpp"
#include "beats/map_files.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "targets.hpp"

namespace sim2vr::fuzz {
namespace {

using namespace games::beats;

template <class Things>
void requireTimes(const Things& things, const Level& level) {
  double last_s = 0.0;
  for (const auto& thing : things) {
    require(thing.time_s >= last_s && thing.time_s <= level.length_s, "the order of times");
    last_s = thing.time_s;
    require(std::isfinite(thing.column) && std::isfinite(thing.row), "a place");
  }
}

void check(const MapFiles& files) {
  logger().set_level(spdlog::level::off);
  try {
    const Level level = readMapLevel(files, "", "");
    require(!level.boxes.empty() && level.hash.size() == 16, "a level");
    require(level.speed_mps >= 1.0 && level.approach_s > 0.0, "an approach");
    requireTimes(level.boxes, level);
    requireTimes(level.mines, level);
    requireTimes(level.walls, level);
    for (const Wall& wall : level.walls) require(wall.duration_s >= 0.0, "a wall");
    require(levelFacts(level).boxes <= level.boxes.size(), "facts");
    require(!timelineJson(level).empty(), "a timeline");
  } catch (const InvalidArgument& error) {
    const bool named = error.field().starts_with(files.where()) ||
                       error.field().starts_with("option 'characteristic'");
    require(named, "an error names its file or option");
  }
}

std::string takePart(std::string_view& input) {
  const std::size_t end = std::min(input.find('\0'), input.size());
  std::string part(input.substr(0, end));
  input.remove_prefix(std::min(end + 1, input.size()));
  return part;
}

}  // namespace

void level(std::string_view input) {
  std::map<std::string, std::string> files{{"Info.dat", takePart(input)}};
  const std::string difficulty = takePart(input);
  try {
    const MapInfo info = readMapInfo(files["Info.dat"], "Info.dat");
    files[info.audio_file] = takePart(input);
    for (const MapDifficulty& offered : info.difficulties) files[offered.file] = difficulty;
  } catch (const InvalidArgument&) {
    files["Easy.dat"] = difficulty;
  }
  check(MemoryFiles(files, "map"));
}

void levelZip(std::string_view input) {
  try {
    check(*filesOfZip(std::string(input), "zip"));
  } catch (const InvalidArgument& error) {
    require(error.field().starts_with("zip"), "an error names its archive");
  }
}

}  // namespace sim2vr::fuzz

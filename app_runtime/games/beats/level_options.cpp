// SPDX-License-Identifier: Apache-2.0
#include "beats/level_options.hpp"

#include <array>
#include <filesystem>
#include <string>

#include "beats/built_in_levels.hpp"
#include "beats/map_level.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/text.hpp"

namespace sim2vr::games::beats {
namespace {

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

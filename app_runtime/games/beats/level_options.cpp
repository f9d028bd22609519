#include "beats/level_options.hpp"

#include <array>

#include "beats/built_in_levels.hpp"

namespace sim2vr::games::beats {

LevelSettings readLevelSettings(Options& options) {
  static const std::array<std::string, 1> kNames{"first"};
  LevelSettings settings;
  settings.level = options.getChoice("level", settings.level, kNames);
  return settings;
}

Level makeLevel(const LevelSettings& /*settings*/, std::uint32_t /*seed*/) { return firstLevel(); }

}  // namespace sim2vr::games::beats

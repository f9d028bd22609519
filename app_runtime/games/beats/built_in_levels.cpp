// SPDX-License-Identifier: Apache-2.0
#include "beats/built_in_levels.hpp"

#include "beats/level_hash.hpp"
#include "beats/map_level.hpp"

namespace sim2vr::games::beats {

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

}  // namespace sim2vr::games::beats

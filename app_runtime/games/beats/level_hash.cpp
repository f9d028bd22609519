// SPDX-License-Identifier: Apache-2.0
#include "beats/level_hash.hpp"

#include <fmt/format.h>

#include "sim2vr/core/archive.hpp"

namespace sim2vr::games::beats {
namespace {

std::string digits(const Archive& archive) { return fmt::format("{:016x}", archive.hash()); }

void addBoxes(Archive& archive, Level& level) {
  for (Box& box : level.boxes) {
    archive.field("time_s", box.time_s);
    archive.field("column", box.column);
    archive.field("row", box.row);
    archive.field("hand", box.hand, Hand::kRight);
    archive.field("cut", box.cut, CutDirection::kAny);
    archive.field("angle_offset_deg", box.angle_offset_deg);
    archive.field("link", box.link);
  }
}

void addMines(Archive& archive, Level& level) {
  for (Mine& mine : level.mines) {
    archive.field("time_s", mine.time_s);
    archive.field("column", mine.column);
    archive.field("row", mine.row);
  }
}

void addWalls(Archive& archive, Level& level) {
  for (Wall& wall : level.walls) {
    archive.field("time_s", wall.time_s);
    archive.field("duration_s", wall.duration_s);
    archive.field("column", wall.column);
    archive.field("row", wall.row);
    archive.field("width", wall.width);
    archive.field("height", wall.height);
  }
}

}  // namespace

std::string bytesHash(std::string_view bytes) {
  Archive archive = Archive::saver();
  std::string copy(bytes);
  archive.field("bytes", copy);
  return digits(archive);
}

std::string contentHash(Level level) {
  Archive archive = Archive::saver();
  archive.field("name", level.name);
  archive.field("length_s", level.length_s);
  archive.field("beats_per_minute", level.beats_per_minute);
  archive.field("speed_mps", level.speed_mps);
  archive.field("approach_s", level.approach_s);
  for (TempoChange& change : level.tempo_changes) {
    archive.field("time_s", change.time_s);
    archive.field("beats_per_minute", change.beats_per_minute);
  }
  addBoxes(archive, level);
  addMines(archive, level);
  addWalls(archive, level);
  return digits(archive);
}

}  // namespace sim2vr::games::beats

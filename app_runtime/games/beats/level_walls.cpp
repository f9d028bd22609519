#include "beats/level_walls.hpp"

#include <algorithm>

namespace sim2vr::games::beats {
namespace {

/// From one wall's end to the next one's start.
constexpr double kStandUp_s = 2.0;
constexpr double kLongest_s = 0.9;
/// The player is out of the way so long before and after a wall.
constexpr double kBefore_s = 0.4;
constexpr double kAfter_s = 0.25;
/// Starts lie on tenths of a second.
constexpr double kStep_s = 0.1;

Wall shape(int kind) {
  switch (kind) {
    case 0:
      return {.column = 0.0, .row = 0.0, .width = 2.0, .height = 5.0};
    case 1:
      return {.column = 2.0, .row = 0.0, .width = 2.0, .height = 5.0};
    default:
      return {.column = 0.0, .row = 2.0, .width = 4.0, .height = 3.0};
  }
}

}  // namespace

std::vector<Wall> placeWalls(double per_minute, double from_s, double to_s, Random& random) {
  std::vector<Wall> walls;
  const double span_s = to_s - from_s;
  const int most = static_cast<int>(span_s / (kStandUp_s + kLongest_s));
  const int count = std::min(static_cast<int>(per_minute * span_s / 60.0 + 0.5), most);
  for (int i = 0; i < count; ++i) {
    const double window_s = span_s / count;
    Wall wall = shape(random.range(0, 3));
    wall.duration_s = kLongest_s * random.range(1, 4) / 3.0;
    const double room_s = window_s - kStandUp_s - wall.duration_s;
    const int steps = static_cast<int>(room_s / kStep_s);
    wall.time_s = from_s + i * window_s + kStep_s * random.range(0, steps + 1);
    walls.push_back(wall);
  }
  return walls;
}

bool isBehindWall(const std::vector<Wall>& walls, double time_s, double column, double row) {
  return std::any_of(walls.begin(), walls.end(), [&](const Wall& wall) {
    const bool meanwhile =
        time_s > wall.time_s - kBefore_s && time_s < wall.time_s + wall.duration_s + kAfter_s;
    return meanwhile && column > wall.column - 1.0 && column < wall.column + wall.width &&
           row > wall.row - 1.0 && row < wall.row + wall.height;
  });
}

}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
#include "beats/layout.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "beats/directions.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr double kMiddleOfColumns = 1.5;

Vec3 cellCenter_m(const Layout& layout, double column, double row, double z_m) {
  return {(column - kMiddleOfColumns) * layout.cell_width_m, rowHeight_m(layout, row), z_m};
}

double depth_m(const Level& level, const Wall& wall) {
  return std::max(wall.duration_s * level.speed_mps, kShallowestWall_m);
}

double wallHeight_m(const Layout& layout, const Wall& wall) {
  if (!layout.rows_m) return wall.height * layout.cell_height_m;
  const double bottom = wall.row - 0.5;
  return rowHeight_m(layout, bottom + wall.height) - rowHeight_m(layout, bottom);
}

}  // namespace

double rowHeight_m(const Layout& layout, double row) {
  if (!layout.rows_m) return layout.middle_row_m + (row - 1.0) * layout.cell_height_m;
  const auto& [bottom, middle, top] = *layout.rows_m;
  return middle + (row - 1.0) * (row < 1.0 ? middle - bottom : top - middle);
}

// A mark that points down points along the cut when it is turned by this.
double boxTurn_rad(const Box& box) {
  if (box.cut == CutDirection::kAny) return box.angle_offset_deg * std::numbers::pi / 180.0;
  const Eigen::Vector2d cut = cutVector(box);
  return std::atan2(cut.x(), -cut.y());
}

Block boxAt(const Layout& layout, const Level& level, const Box& box, double time_s) {
  const double z_m = layout.cut_distance_m + level.speed_mps * (box.time_s - time_s);
  const double edge_m = box.link ? layout.link_edge_m : layout.box_edge_m;
  return {cellCenter_m(layout, box.column, box.row, z_m), Vec3::Constant(edge_m / 2.0),
          boxTurn_rad(box)};
}

Block mineAt(const Layout& layout, const Level& level, const Mine& mine, double time_s) {
  const double z_m = layout.cut_distance_m + level.speed_mps * (mine.time_s - time_s);
  return {cellCenter_m(layout, mine.column, mine.row, z_m), Vec3::Zero(), 0.0};
}

Block wallAt(const Layout& layout, const Level& level, const Wall& wall, double time_s) {
  const Vec3 size(wall.width * layout.cell_width_m, wallHeight_m(layout, wall),
                  depth_m(level, wall));
  // The lower left edge of cell (column, row) lies half a cell from its middle.
  const Vec3 corner = cellCenter_m(layout, wall.column - 0.5, wall.row - 0.5,
                                   level.speed_mps * (wall.time_s - time_s));
  return {corner + size / 2.0, size / 2.0, 0.0};
}

double passTime_s(const Layout& layout, const Level& level, double time_s) {
  return time_s + layout.cut_distance_m / level.speed_mps;
}

double goneTime_s(const Level& level, const Wall& wall) {
  return wall.time_s + (depth_m(level, wall) + kWallGone_m) / level.speed_mps;
}

}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
// Where things are: from the level's cells and seconds to metres relative to the round's origin.
#pragma once

#include <array>
#include <optional>

#include "beats/level.hpp"
#include "sim2vr/core/math.hpp"

namespace sim2vr::games::beats {

/// Sizes and places; the defaults let a body whose trunk does not move cut every cell with either
/// hand (docs/reference/games/beats.md). The origin is the head's position in the round's
/// first frame, axes are the world's.
struct Layout {
  double cell_width_m = 0.40;
  double cell_height_m = 0.35;
  /// y of the middle row.
  double middle_row_m = -0.30;
  /// y of the three rows, where they are not evenly spaced; instead of the two numbers above.
  std::optional<std::array<double, 3>> rows_m;
  /// z at which boxes and mines are at their time.
  double cut_distance_m = 0.80;
  double box_edge_m = 0.35;
  /// Width, height (along the cut) and depth of what a correct cut has to touch of a box; nothing:
  /// the box itself.
  std::optional<Vec3> hit_box_m;
  /// How much nearer to the player its middle is than the box's.
  double hit_box_nearer_m = 0.0;
  /// Of a link of a chain.
  double link_edge_m = 0.175;
  double mine_radius_m = 0.12;
  double head_radius_m = 0.08;
  /// From the grip to the blade.
  double blade_start_m = 0.08;
  double blade_length_m = 1.0;
};

/// A cuboid that rods are tested against; a point where half_m is 0.
struct Block {
  Vec3 center_m = Vec3::Zero();
  Vec3 half_m = Vec3::Zero();
  /// About z, counter-clockwise as the player sees it.
  double turn_rad = 0.0;
};

inline constexpr double kShallowestWall_m = 0.05;
/// Behind the head plane by this much a wall's back is when it is gone.
inline constexpr double kWallGone_m = 0.5;

/// y of a row's middle; rows may be fractions and may lie outside the grid.
double rowHeight_m(const Layout& layout, double row);

/// How far a box is turned about z: at 0 its mark points down.
double boxTurn_rad(const Box& box);

/// Positions at level time `time_s`. Of a mine the middle alone: it is what lies within its radius.
Block boxAt(const Layout& layout, const Level& level, const Box& box, double time_s);
Block mineAt(const Layout& layout, const Level& level, const Mine& mine, double time_s);
Block wallAt(const Layout& layout, const Level& level, const Wall& wall, double time_s);

/// When a box or mine of that time is in the head plane.
double passTime_s(const Layout& layout, const Level& level, double time_s);
/// When a wall is gone.
double goneTime_s(const Level& level, const Wall& wall);

}  // namespace sim2vr::games::beats

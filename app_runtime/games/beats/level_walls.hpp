// Walls of generated levels.
#pragma once

#include <vector>

#include "beats/level.hpp"
#include "sim2vr/core/random.hpp"

namespace sim2vr::games::beats {

/// Walls between two times, evenly spread with chance in it: the left or the right half of the
/// lane, or the upper part of its whole width. Between two is time to stand up again.
std::vector<Wall> placeWalls(double per_minute, double from_s, double to_s, Random& random);

/// Whether a box of that time and cell would be in a wall, or so close before or behind one that
/// the player, who is dodging it, does not reach it well.
bool isBehindWall(const std::vector<Wall>& walls, double time_s, double column, double row);

}  // namespace sim2vr::games::beats

// The levels that come with the game.
#pragma once

#include "beats/level.hpp"

namespace sim2vr::games::beats {

/// Ten seconds with four boxes, one at a time on alternating sides, cut along the diagonals; no
/// walls, no mines: what the paper's users play.
Level firstLevel();

}  // namespace sim2vr::games::beats

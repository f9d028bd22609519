// SPDX-License-Identifier: Apache-2.0
// The levels that come with the game.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "beats/level.hpp"

namespace sim2vr::games::beats {

/// Ten seconds with four boxes, one at a time on alternating sides, cut along the diagonals; no
/// walls, no mines: what the paper's users play.
Level firstLevel();

/// A minute of our own with boxes, walls and mines: the map in levels/full.
std::shared_ptr<const Level> fullLevel();

/// The files of levels/full, which the build puts into the library.
const std::map<std::string, std::string>& fullMap();

}  // namespace sim2vr::games::beats

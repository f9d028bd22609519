// SPDX-License-Identifier: Apache-2.0
// A level as a picture over time, in the words that the harness draws any game's timeline with.
#pragma once

#include <string>

#include "beats/level.hpp"

namespace sim2vr::games::beats {

/// A JSON object as rl::Game::timelineJson says: the cells of the grid are its lanes, row by row
/// from the bottom. Its `level` has what Level has; hands are 0 (left) and 1 (right), cuts 0 to 8.
std::string timelineJson(const Level& level);

}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
// The numbers behind the picture that a teacher learns from (docs/reference/games/beats.md,
// "Privileged observations").
#pragma once

#include <span>
#include <string>
#include <vector>

#include "beats/sight.hpp"

namespace sim2vr::games::beats {

/// How many are reported: of each hand's boxes, of mines, of walls.
inline constexpr std::size_t kShownBoxes = 2;
inline constexpr std::size_t kShownMines = 3;
inline constexpr std::size_t kShownWalls = 2;

const std::vector<std::string>& privilegedNames();

/// Writes one value for each of privilegedNames().
void writePrivileged(const Round& round, const Sight& sight, std::span<float> values);

}  // namespace sim2vr::games::beats

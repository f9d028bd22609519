// SPDX-License-Identifier: Apache-2.0
// What can be said of a level without playing it.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "beats/level.hpp"

namespace sim2vr::games::beats {

struct LevelFacts {
  std::size_t boxes = 0;
  std::size_t links = 0;
  std::size_t mines = 0;
  std::size_t walls = 0;
  double seconds = 0.0;
  /// Boxes per second from the first to the last one, and in the fullest second.
  double boxes_per_s = 0.0;
  double peak_boxes_per_s = 0.0;
  /// Boxes that ask a hand to go on in the direction in which it has just cut: the blade has to be
  /// brought back first.
  std::vector<std::size_t> parity_problems;
};

/// A hand with more time than this brings its blade back at leisure.
inline constexpr double kBringBack_s = 1.0;
/// Boxes of a hand that are so close to each other are one stroke.
inline constexpr double kOneStroke_s = 0.1;

LevelFacts levelFacts(const Level& level);

}  // namespace sim2vr::games::beats

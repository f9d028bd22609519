// SPDX-License-Identifier: Apache-2.0
// Where the targets of a block are, which one is next, and how hard it is to reach.
#pragma once

#include <cstdint>
#include <vector>

#include "pointing/settings.hpp"

namespace sim2vr::games::pointing {

/// A run of movements of one distance and width around the circle.
struct Block {
  double distance_m = 0.0;
  double width_m = 0.0;

  /// log2(D / W + 1), bits (ISO 9241-411; Shannon's form).
  double index_bits() const;
};

/// All blocks of a round in the order in which they are played, drawn with a generator of its own.
std::vector<Block> drawBlocks(const Settings& settings, std::uint32_t seed);

/// The number of the target that is up in trial `trial` of a block, 0 to `targets`: trial 0 begins
/// at target 0, each next target lies opposite, and the last trial ends at target 0.
int targetOfTrial(int trial, int targets);

/// Centre of a target from the circle's centre, in the plane (z = 0). Target 0 is at the top; they
/// are numbered clockwise as the player sees them. The circle is such that targets that follow each
/// other are the block's distance apart: its diameter is D / cos(pi / 2n), 1.5 % more for n = 9.
Vec3 targetCenter_m(int target, int targets, double distance_m);

}  // namespace sim2vr::games::pointing

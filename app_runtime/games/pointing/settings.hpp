// SPDX-License-Identifier: Apache-2.0
// The options of a round of pointing (docs/reference/games/pointing.md).
#pragma once

#include <string>
#include <vector>

#include "sim2vr/core/math.hpp"
#include "sim2vr/core/options.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::games::pointing {

inline constexpr int kMostTargets = 25;
inline constexpr int kMostBlocks = 25;

struct Settings {
  /// Targets on the circle; odd, so that there is a next one opposite.
  int targets = 9;
  /// From the centre of a target to that of the next one in turn. Every distance comes with every
  /// width: a block each. These nine have nine indices of difficulty, from 1.7 to 4.1 bits.
  std::vector<double> distances_m{0.10, 0.18, 0.32};
  std::vector<double> widths_m{0.02, 0.03, 0.045};
  /// How often each block comes up in a round.
  int repeats = 1;

  /// Centre of the circle from the head at the start of the round, world axes; to the side of the
  /// hand that plays.
  double side_m = 0.15;
  double height_m = -0.10;
  double depth_m = 0.40;
  /// Ask the player to look at the centre.
  bool head_request = true;

  /// From the grip to the tip of the stylus.
  double stylus_m = 0.10;
  /// The tip must come so far out of the plane between two selections.
  double rearm_m = 0.0;
  float timeout_s = 3.0F;
  xr::Hand hand = xr::Hand::right;

  /// Hits and errors only.
  bool sparse = false;
  double error_cost = 5.0;

  Vec3 center_m() const { return {hand == xr::Hand::left ? -side_m : side_m, height_m, depth_m}; }

  /// Throws InvalidArgument naming the option.
  static Settings fromOptions(Options& options);

  /// A JSON object with the options that decide what happens in a round, as far as they are not
  /// the default.
  std::string playOptionsJson() const;
};

}  // namespace sim2vr::games::pointing

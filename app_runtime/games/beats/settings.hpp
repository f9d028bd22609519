// SPDX-License-Identifier: Apache-2.0
// The game's options.
#pragma once

#include "beats/level.hpp"
#include "beats/level_options.hpp"
#include "beats/swing.hpp"
#include "sim2vr/core/options.hpp"

namespace sim2vr::games::beats {

struct Settings {
  LevelSettings level;
  Layout layout;
  ScoreRules score;

  bool end_on_miss = true;
  bool multiplier = false;
  bool energy = false;
  double wall_errors_per_second = 0.0;
  double lead_in_s = 0.0;
  /// The origin lies on the floor in the middle of the tracking space and follows the head's z,
  /// instead of where the head is in the first frame.
  bool floor_origin = false;
  bool time_feature = false;

  /// Whether the reward has more than the score.
  bool shaped = false;
  double approach_reward = 10.0;
  double miss_penalty = 0.0;
  double error_penalty = 0.0;

  /// Throws InvalidArgument naming the option.
  static Settings fromOptions(Options& options);
};

}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
// Levels made of a seed, for training and for levels that no user has played.
//
// They can be played: a hand's cuts go back and forth (down, up, down ...), so that each stroke
// begins where the last one ended; no box lies in a wall that the head avoids, walls leave time to
// dodge, and no mine lies where a stroke has to pass.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "beats/level.hpp"

namespace sim2vr::games::beats {

struct GeneratorSettings {
  /// On average; a little less where walls keep boxes out.
  double boxes_per_second = 1.0;
  /// One of generatorPatterns().
  std::string pattern = "mixed";
  /// Of approach.
  double speed_mps = 5.0;
  /// Each level is faster or slower than that by at most this.
  double speed_spread_mps = 0.0;
  double walls_per_minute = 6.0;
  /// Fewer where strokes leave no room.
  double mines_per_minute = 6.0;
  double seconds = 60.0;
};

/// "alternating": left, right, left ... "together": both hands at once. "any": alternating, to be
/// cut in any direction. "mixed": alternating, together, and one hand twice. "song": as mixed, and
/// closer in time, low rows more often, strokes to the side, hands that cross; at 80 to 150 beats a
/// minute.
std::span<const std::string> generatorPatterns();

/// Same settings and seed, same bits on every platform.
Level generateLevel(const GeneratorSettings& settings, std::uint32_t seed);

}  // namespace sim2vr::games::beats

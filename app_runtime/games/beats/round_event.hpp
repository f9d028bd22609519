// SPDX-License-Identifier: Apache-2.0
// What can happen within a frame of a round.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "beats/round.hpp"

namespace sim2vr::games::beats {

/// A blade that meets something.
struct Round::Touch {
  double time_s;
  Hand hand;
  Vec3 place_m;
  /// Of the blade where it is nearest to the thing's middle, across the blade.
  Vec3 velocity_mps;
};

struct Round::Event {
  enum class Kind : std::uint8_t {
    kCut,
    kMiss,
    kMineTouched,
    kMineAvoided,
    kWallTouched,
    kWallGone
  };
  double time_s;
  Kind kind;
  /// In the level's list.
  std::size_t index;
  Vec3 place_m;
  std::optional<Touch> touch = std::nullopt;
};

}  // namespace sim2vr::games::beats

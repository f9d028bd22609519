// SPDX-License-Identifier: Apache-2.0
// The game's colours, read off the reference's videos; those of mines and walls are ours.
// Everything is as bright as its colour says, whatever the light.
#pragma once

#include "beats/level.hpp"
#include "sim2vr/render/material.hpp"

namespace sim2vr::games::beats {

inline constexpr render::Color kRed{248.0F / 255.0F, 24.0F / 255.0F, 24.0F / 255.0F, 1.0F};
inline constexpr render::Color kCyan{24.0F / 255.0F, 248.0F / 255.0F, 248.0F / 255.0F, 1.0F};
inline constexpr render::Color kRail{248.0F / 255.0F, 56.0F / 255.0F, 56.0F / 255.0F, 1.0F};
// Boxes are bright in either red or blue, what must not be touched is bright in both: mines in
// green, too, walls not.
inline constexpr render::Color kMineColor{208.0F / 255.0F, 208.0F / 255.0F, 208.0F / 255.0F, 1.0F};
inline constexpr render::Color kWallColor{248.0F / 255.0F, 24.0F / 255.0F, 248.0F / 255.0F, 1.0F};

inline const render::Color& colorOf(Hand hand) { return hand == Hand::kLeft ? kRed : kCyan; }

}  // namespace sim2vr::games::beats

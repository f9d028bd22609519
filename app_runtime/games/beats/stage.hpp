// SPDX-License-Identifier: Apache-2.0
// Shows what is out: boxes, mines, walls, and what has just gone to pieces.
#pragma once

#include <array>
#include <vector>

#include "beats/level.hpp"
#include "beats/round.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/render/material.hpp"

namespace sim2vr::games::beats {

// The game's colours, read off the reference's videos; those of mines and walls are ours.
// Everything is as bright as its colour says, whatever the light.

inline constexpr render::Color kRed{248.0F / 255.0F, 24.0F / 255.0F, 24.0F / 255.0F, 1.0F};
inline constexpr render::Color kCyan{24.0F / 255.0F, 248.0F / 255.0F, 248.0F / 255.0F, 1.0F};
inline constexpr render::Color kRail{248.0F / 255.0F, 56.0F / 255.0F, 56.0F / 255.0F, 1.0F};
// Boxes are bright in either red or blue, what must not be touched is bright in both: mines in
// green, too, walls not.
inline constexpr render::Color kMineColor{208.0F / 255.0F, 208.0F / 255.0F, 208.0F / 255.0F, 1.0F};
inline constexpr render::Color kWallColor{248.0F / 255.0F, 24.0F / 255.0F, 248.0F / 255.0F, 1.0F};

inline const render::Color& colorOf(Hand hand) { return hand == Hand::kLeft ? kRed : kCyan; }

/// Keeps as many objects as a level ever has out at once, and puts them where the round says. It
/// has no state of its own.
class Stage : public scene::Component {
 public:
  explicit Stage(const Round& round) : round_(round) {}

  std::string_view typeName() const override { return "beats.Stage"; }
  void Awake() override;
  void LateUpdate() override;

 private:
  struct BoxLooks {
    render::MeshRenderer* arrow = nullptr;
    render::MeshRenderer* dot = nullptr;
  };

  void showBoxes();
  void showMines();
  void showWalls();
  void showBursts();

  const Round& round_;
  scene::GameObject* lane_ = nullptr;
  std::vector<BoxLooks> boxes_;
  std::vector<render::MeshRenderer*> mines_, walls_;
  /// By Round::Burst::Of.
  std::array<render::Billboards*, 3> sparks_{};
};

}  // namespace sim2vr::games::beats

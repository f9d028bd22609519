// SPDX-License-Identifier: Apache-2.0
// Shows what is out: boxes, mines, walls, and what has just gone to pieces.
#pragma once

#include <array>
#include <vector>

#include "beats/round.hpp"
#include "sim2vr/render/components.hpp"

namespace sim2vr::games::beats {

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

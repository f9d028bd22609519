// SPDX-License-Identifier: Apache-2.0
// What a target shows: its body with two black rings, and the burst of sparks of a hit.
#pragma once

#include "sim2vr/render/components.hpp"
#include "sim2vr/scene/component.hpp"
#include "sim2vr/scene/game_object.hpp"

namespace sim2vr::games::whacamole {

class TargetLooks : public scene::Component {
 public:
  std::string_view typeName() const override { return "whacamole.TargetLooks"; }
  /// Adds the renderers to the target and a child for the rings.
  void Awake() override;

  /// Green at 0 to red at 1 of the life.
  void showAge(float fraction);
  /// Black, rings invisible on it.
  void showMissed();
  /// Only the sparks, `elapsed_s` after the hit.
  void showBurst(float elapsed_s);

 private:
  render::MeshRenderer* body_ = nullptr;
  render::MeshRenderer* rings_ = nullptr;
  render::Billboards* sparks_ = nullptr;
};

}  // namespace sim2vr::games::whacamole

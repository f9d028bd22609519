// SPDX-License-Identifier: Apache-2.0
// What Whac-A-Mole looks like, apart from the targets: shapes, colours, light, cameras.
#pragma once

#include "sim2vr/core/math.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/scene/component.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::games::whacamole {

// What a target shows: its body with two black rings, and the burst of sparks of a hit.

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

/// Barrel head and handle below the hammer's root (hammer units are a tenth of a metre).
void addHammerLooks(scene::GameObject& hammer);
/// The translucent controller around the hammer's handle.
void addControllerLooks(scene::GameObject& controller, xr::Hand hand);
/// The translucent sheet that the targets come out of.
void addAreaLooks(scene::GameObject& area, double edge_m);
/// Where the spectators' camera stands for a round that starts with the head at `head_m` (world):
/// behind the player on the side of the hammer's hand, with head, hammer and each of the areas in
/// view.
Pose spectatorPose(const Vec3& head_m, xr::Hand hand);
/// Platform, floor arrow, lights, sky and the two outside cameras; lit from the other side for a
/// left hand, so that all of its picture is the mirror image.
void addRoomLooks(scene::Scene& scene, xr::Hand hand);

}  // namespace sim2vr::games::whacamole

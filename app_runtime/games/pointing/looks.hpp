// SPDX-License-Identifier: Apache-2.0
// What pointing looks like: the stylus, the targets, the room. In red light only the target that is
// up is bright.
#pragma once

#include <vector>

#include "pointing/round.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/scene/component.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::games::pointing {

/// A pen below the controller, with its tip `length_m` in front of the grip.
void addStylusLooks(scene::GameObject& controller, double length_m);
/// Floor, light, and the two cameras from outside.
void addRoomLooks(scene::Scene& scene, scene::GameObject& head_camera, xr::Hand hand);
/// Puts the cameras from outside to where the player stands, on the side of the hand that plays.
void placeCameras(scene::Scene& scene, const Vec3& head_m, xr::Hand hand);

/// The circle: a disc for the target that is up, another for what happened last, rings for the
/// places of the others.
class Board : public scene::Component {
 public:
  static constexpr float kFlash_s = 0.2F;

  explicit Board(const Round& round) : round_(round) {}
  std::string_view typeName() const override { return "pointing.Board"; }
  void Awake() override;
  void LateUpdate() override;

 private:
  const Round& round_;
  render::MeshRenderer* sheet_ = nullptr;
  render::MeshRenderer* disc_ = nullptr;
  render::MeshRenderer* flash_ = nullptr;
  std::vector<render::MeshRenderer*> rings_;
};

}  // namespace sim2vr::games::pointing

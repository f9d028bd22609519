// SPDX-License-Identifier: Apache-2.0
// The panel's plate, the rays and cursors of the hands, the room.
#pragma once

#include <vector>

#include "panel/round.hpp"
#include "sim2vr/scene/component.hpp"

namespace sim2vr::games::panel {

/// Floor, light, controllers, and the two cameras from outside.
void addRoomLooks(scene::Scene& scene, const rl::XrRig& rig, Select select);
/// Puts the cameras from outside to where they see the player and the panel.
void placeCameras(scene::Scene& scene, const Vec3& head_m, const Vec3& panel_m);

/// Shows the state of a round: widgets, cursors, and rays that are absent from the depth channel.
class Looks : public scene::Component {
 public:
  explicit Looks(const Round& round) : round_(round) {}
  std::string_view typeName() const override { return "panel.Looks"; }
  void Awake() override;
  void LateUpdate() override;

 private:
  const Round& round_;
  std::vector<render::MeshRenderer*> rays_, cursors_;
};

}  // namespace sim2vr::games::panel

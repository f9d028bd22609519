#include "pointing/game.hpp"

#include <cmath>
#include <numbers>

#include "pointing/env.hpp"
#include "pointing/looks.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::pointing {

rl::RLEnv& Pointing::build(rl::GameContext& context) {
  scene::Scene& scene = context.scene;
  const Feedback feedback(context.xr, context.sounds, settings_.hand);
  const rl::XrRig rig = rl::buildXrRig(context);
  scene::GameObject& controller =
      settings_.hand == xr::Hand::left ? *rig.left_controller : *rig.right_controller;
  addStylusLooks(controller, settings_.stylus_m);
  addRoomLooks(scene, *rig.camera, settings_.hand);

  auto& round = scene.create("Round").addComponent<Round>(RoundSetup{
      settings_, context.seed, rig, Stylus(controller, settings_.stylus_m, settings_.rearm_m),
      feedback, context.logger});
  scene.create("Board").addComponent<Board>(round);
  return scene.create("RL Environment")
      .addComponent<Env>(round, Privileged(round, *rig.camera, context.xr.settings().aspect));
}

std::optional<double> Pointing::headRequest(std::uint32_t) const {
  if (!settings_.head_request) return std::nullopt;
  return std::atan2(settings_.height_m, settings_.depth_m) * 180.0 / std::numbers::pi;
}

const std::vector<std::string>& Pointing::privilegedNames() const { return Privileged::names(); }

}  // namespace sim2vr::games::pointing

#include "whacamole/game.hpp"

#include "sim2vr/physics/world.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/xr/session.hpp"
#include "whacamole/env.hpp"
#include "whacamole/hammer.hpp"
#include "whacamole/layers.hpp"
#include "whacamole/looks.hpp"
#include "whacamole/target.hpp"

namespace sim2vr::games::whacamole {
namespace {

void restrictCollisions(physics::PhysicsWorld& physics) {
  for (int a = 0; a < physics::kLayers; ++a) {
    for (int b = a; b < physics::kLayers; ++b) {
      physics.setLayerCollision(a, b, a == kTargetLayer && b == kPlayerLayer);
    }
  }
}

scene::GameObject& buildArea(scene::Scene& scene, const Settings& settings) {
  scene::GameObject& area = scene.create("Target Area");
  // It reaches a target's radius beyond the outer cells' centres.
  addAreaLooks(area, settings.area_size_m + 2.0 * settings.target_radius_m);
  area.setActive(false);
  return area;
}

}  // namespace

void WhacAMole::configure(Options& options) { settings_ = Settings::fromOptions(options); }

rl::RLEnv& WhacAMole::build(rl::GameContext& context) {
  scene::Scene& scene = context.scene;
  restrictCollisions(context.physics);

  RoundSetup setup;
  setup.settings = settings_;
  setup.condition = resolveCondition(settings_.condition, context.seed);
  setup.seed = context.seed;
  if (settings_.adaptive && settings_.spawn_weights.empty()) {
    setup.settings.spawn_weights = adaptiveWeights(tally_.failRates());
  }
  tally_ = CellTally{};

  setup.rig = rl::buildXrRig(context);
  scene::GameObject& controller =
      settings_.hand == xr::Hand::left ? *setup.rig.left_controller : *setup.rig.right_controller;
  if (settings_.show_controllers) addControllerLooks(controller, settings_.hand);
  Hammer& hammer = buildHammer(controller, settings_);
  setup.area = &buildArea(scene, settings_);
  setup.hammer = &hammer;
  setup.tally = &tally_;
  setup.logger = context.logger;

  auto& round = scene.create("Round").addComponent<Round>(setup);
  registerTargetPrefab(scene, round, hammer);
  auto& env = scene.create("RL Environment")
                  .addComponent<Env>(round, Privileged(round, *setup.rig.camera, *setup.area,
                                                       context.xr.settings().aspect));
  addRoomLooks(scene, settings_.hand);
  return env;
}

std::optional<double> WhacAMole::headRequest(std::uint32_t seed) const {
  if (!settings_.head_request) return std::nullopt;
  const Placement placement = resolveCondition(settings_.condition, seed).placement;
  return geometry(placement, settings_.hand, settings_.area).head_pitch_deg;
}

const std::vector<std::string>& WhacAMole::privilegedNames() const { return Privileged::names(); }

void WhacAMole::fields(Archive& archive) { archive.field("tally", tally_); }

}  // namespace sim2vr::games::whacamole

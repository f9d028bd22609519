#include "beats/game.hpp"

#include <utility>

#include "beats/env.hpp"
#include "beats/level_timeline.hpp"
#include "beats/privileged.hpp"
#include "beats/saber_looks.hpp"
#include "beats/stage.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::beats {

rl::RLEnv& Beats::build(rl::GameContext& context) {
  return buildRound(context, settings_,
                    std::make_shared<const Level>(makeLevel(settings_.level, context.seed)));
}

rl::RLEnv& buildRound(rl::GameContext& context, const Settings& settings,
                      std::shared_ptr<const Level> level) {
  // The game's own actions are made before the rig attaches them.
  const Feedback feedback(context.xr, context.sounds);
  RoundSetup setup;
  setup.settings = settings;
  setup.level = std::move(level);
  setup.rig = rl::buildXrRig(context);
  setup.seed = context.seed;
  setup.logger = context.logger;
  const Rod blade = bladeOf(settings.layout);
  addSaberLooks(*setup.rig.left_controller, Hand::kLeft, blade);
  addSaberLooks(*setup.rig.right_controller, Hand::kRight, blade);

  scene::Scene& scene = context.scene;
  auto& round = scene.create("Round").addComponent<Round>(setup, feedback);
  scene.create("Stage").addComponent<Stage>(round);
  return scene.create("RL Environment").addComponent<Env>(round, context.xr.settings().aspect);
}

const std::vector<std::string>& Beats::privilegedNames() const { return beats::privilegedNames(); }

std::string Beats::timelineJson(std::uint32_t seed) const {
  return beats::timelineJson(makeLevel(settings_.level, seed));
}

}  // namespace sim2vr::games::beats

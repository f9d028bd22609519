// SPDX-License-Identifier: Apache-2.0
// A game made for tests, of the smallest kind that uses every device: a drum.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "sim2vr/render/components.hpp"
#include "sim2vr/rl/game.hpp"
#include "sim2vr/rl/sound.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/runtime/app.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::runtime::testing {

/// Beats once for each pull of a trigger: a pulse in that hand, and a sound from 1 m ahead.
class DrumEnv final : public rl::RLEnv {
 public:
  DrumEnv(xr::Session& xr, const xr::Action& beat, const xr::Action& shake, rl::SoundLog& sounds)
      : xr_(xr), beat_(beat), shake_(shake), sounds_(sounds) {}

  std::string_view typeName() const override { return "test.Drum"; }
  void declareLog() override {
    logColumn("Beats", [this] { return beats_; });
  }
  double calculateReward() override {
    double reward = 0.0;
    for (const xr::Hand hand : xr::kHands) {
      const xr::ActionState& beat = xr_.actionState(beat_, hand);
      if (!beat.pressed() || !beat.changed) continue;
      reward += 1.0;
      ++beats_;
      xr_.applyHapticFeedback(shake_, hand,
                              {XR_TYPE_HAPTIC_VIBRATION, nullptr, 30'000'000, 80.0F, 0.25F});
      sounds_.play({"drum", Vec3(0.0, 1.0, 1.0), 0.5F});
    }
    return reward;
  }
  bool isOver() const override { return false; }
  float timeFeature() const override { return 0.0F; }

 private:
  xr::Session& xr_;
  const xr::Action& beat_;
  const xr::Action& shake_;
  rl::SoundLog& sounds_;
  int beats_ = 0;
};

class Drum final : public rl::Game {
 public:
  std::string_view name() const override { return "drum"; }
  std::string_view description() const override { return "a drum"; }
  /// Metres ahead of the player's resting head at which a white ball of 12 cm hangs.
  void configure(Options& options) override {
    ball_m_ = options.getNumber("ball_m", 1.0, 0.1, 10.0);
  }

  rl::RLEnv& build(rl::GameContext& context) override {
    xr::ActionSet& set = context.xr.createActionSet("drum");
    xr::Action& beat = context.xr.createAction(set, "beat", XR_ACTION_TYPE_BOOLEAN_INPUT);
    xr::Action& shake = context.xr.createAction(set, "shake", XR_ACTION_TYPE_VIBRATION_OUTPUT);
    for (const std::string hand : {"/user/hand/left", "/user/hand/right"}) {
      context.xr.suggestBinding(beat, hand + "/input/trigger/value");
      context.xr.suggestBinding(shake, hand + "/output/haptic");
    }
    rl::buildXrRig(context);
    scene::GameObject& ball = context.scene.create("Ball");
    ball.transform().setPosition({0.0, 1.0, ball_m_});
    ball.transform().setLocalScale(0.06);
    ball.addComponent<render::MeshRenderer>(render::sphere(16)).material.unlit = true;
    return context.scene.create("Env").addComponent<DrumEnv>(context.xr, beat, shake,
                                                             context.sounds);
  }

 private:
  double ball_m_ = 1.0;
};

inline AppFactory drums() {
  return gameApps([](std::string_view) { return std::make_unique<Drum>(); });
}

/// A head at rest at 1 m, looking ahead, and two hands with their triggers.
inline xr::DeviceState drummer(float left_trigger, float right_trigger) {
  xr::DeviceState state;
  state.head.position.y = 1.0F;
  const std::array triggers{left_trigger, right_trigger};
  for (std::size_t i = 0; i < triggers.size(); ++i) {
    state.hands[i].active = true;
    state.hands[i].trigger = triggers[i];
  }
  return state;
}

}  // namespace sim2vr::runtime::testing

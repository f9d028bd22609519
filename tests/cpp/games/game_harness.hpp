// SPDX-License-Identifier: Apache-2.0
// Plays a game frame by frame, as runtime/App does, without pictures.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "sim2vr/core/options.hpp"
#include "sim2vr/physics/world.hpp"
#include "sim2vr/rl/episode_logger.hpp"
#include "sim2vr/rl/game.hpp"
#include "sim2vr/rl/sound.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/frames.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::testing {

struct Poses {
  Pose head;
  Pose controller;
  float trigger = 0.0F;
  /// The other hand has none.
  xr::Hand hand = xr::Hand::right;
};

/// The reference's clock in simulated runs: Unity keeps the fixed step in binary32, so that step 25
/// n lies just after frame n at n * 50 ms.
inline TimeSettings referenceTime() {
  TimeSettings time;
  time.fixed_delta_time_s = 0.002F;
  return time;
}

/// One round of one game. The Game itself is the caller's and may live on.
class GameHarness {
 public:
  GameHarness(rl::Game& game, std::uint32_t seed, const std::string& options_json = "{}",
              const TimeSettings& time = referenceTime(), std::int64_t start_ns = 0,
              rl::EpisodeLogger* logger = nullptr)
      : scene_(time), physics_(scene_) {
    Options options = Options::fromJson(options_json);
    game.configure(options);
    options.expectAllRead();
    scene_.clock().restart(start_ns);
    rl::GameContext context{scene_, session_, physics_, seed, logger, sounds_};
    env_ = &game.build(context);
  }

  void frame(std::int64_t time_ns, const Poses& poses) {
    xr::DeviceState state;
    state.head = xr::toXr(poses.head);
    xr::ControllerState& controller = state.hand(poses.hand);
    controller.active = true;
    controller.grip = xr::toXr(poses.controller);
    controller.trigger = poses.trigger;
    controller.aim = controller.grip;
    frame(time_ns, state);
  }

  void frame(std::int64_t time_ns, const xr::DeviceState& state) {
    session_.nextFrame(time_ns, xr::validated(state));
    env_->beginStep(1);
    scene_.runFrame(time_ns, [this] {
      if (before_physics) before_physics();
      physics_.step();
    });
  }

  /// Frames 0 .. count-1 at n * period_ns with constant poses.
  void idle(int count, const Poses& poses, std::int64_t period_ns = 50'000'000) {
    for (int n = 0; n < count; ++n) frame(n * period_ns, poses);
  }

  std::string save() {
    Archive archive = Archive::saver();
    fields(archive);
    return archive.bytes();
  }
  void load(const std::string& bytes) {
    Archive archive = Archive::loader(bytes);
    fields(archive);
    archive.expectEnd();
  }

  scene::Scene& scene() { return scene_; }
  physics::PhysicsWorld& physics() { return physics_; }
  rl::RLEnv& env() { return *env_; }
  rl::SoundLog& sounds() { return sounds_; }
  xr::Session& session() { return session_; }
  double log(const std::string& name) const { return env_->log().at(name); }

  template <class T>
  std::vector<T*> all() {
    std::vector<T*> found;
    scene_.forEach<T>([&found](T& component) { found.push_back(&component); });
    return found;
  }

  /// Called in each fixed step between FixedUpdate and the overlaps.
  std::function<void()> before_physics;

 private:
  void fields(Archive& archive) {
    archive.field("session", session_);
    archive.field("scene", scene_);
    archive.field("physics", physics_);
  }

  scene::Scene scene_;
  physics::PhysicsWorld physics_;
  rl::SoundLog sounds_;
  xr::Session session_;
  rl::RLEnv* env_ = nullptr;
};

}  // namespace sim2vr::games::testing

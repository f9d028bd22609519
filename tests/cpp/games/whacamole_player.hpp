// SPDX-License-Identifier: Apache-2.0
// Puts the hammer where a test wants it.
#pragma once

#include <cstdint>
#include <string>

#include "game_harness.hpp"
#include "whacamole/game.hpp"
#include "whacamole/round.hpp"

namespace sim2vr::games::whacamole {

// The hammer below the controller and its parts, from the documentation, in metres.
const Pose kControllerToHammer{Vec3(0.0096, -0.0491, -0.0545),
                               Quat(0.63740873, 0.30295587, 0.6412905, 0.301122).normalized()};
const Vec3 kHammerToHead_m(-0.0004010893, 0.13975825, -0.0008178129);
const Vec3 kHammerToMarker_m(-0.0482, 0.1385, -0.0005);

/// Controller pose that puts the hammer's root at `root` with its axes along the world's: its head
/// then reaches 5 cm along x and 2.75 cm along y and z from its centre.
inline Pose controllerForRoot(const Vec3& root) {
  return Pose{root, Quat::Identity()} * kControllerToHammer.inverse();
}

/// A round with a player whose hammer is axis-aligned.
class WhacAMoleRound {
 public:
  /// Frames as far apart as in the reference's runs: the largest binary32 number below 0.05 s.
  static constexpr std::int64_t kPeriod_ns = 49'999'997;

  explicit WhacAMoleRound(const std::string& options_json, std::uint32_t seed = 1,
                          const TimeSettings& time = testing::referenceTime(),
                          rl::EpisodeLogger* logger = nullptr, std::int64_t period_ns = kPeriod_ns)
      : harness(game, seed, options_json, time, 0, logger), period_ns_(period_ns) {}

  void frameWithRoot(const Vec3& root) {
    controller = controllerForRoot(root);
    harness.frame(frames_++ * period_ns_, {{head, Quat::Identity()}, controller});
  }
  /// What the player of another round did last, as its mirror image: head and left hand.
  void frameMirrored(const WhacAMoleRound& other) {
    const auto [position, rotation] = other.controller;
    controller = {{-position.x(), position.y(), position.z()},
                  Quat(rotation.w(), rotation.x(), -rotation.y(), -rotation.z())};
    head = {-other.head.x(), other.head.y(), other.head.z()};
    harness.frame(frames_++ * period_ns_,
                  {{head, Quat::Identity()}, controller, 0.0F, xr::Hand::left});
  }
  /// The head's centre at a world position.
  void frameWithHead(const Vec3& center) { frameWithRoot(center - kHammerToHead_m); }
  void frameWithMarker(const Vec3& marker) { frameWithRoot(marker - kHammerToMarker_m); }
  void idle(int frames = 1) {
    for (int i = 0; i < frames; ++i) frameWithRoot(Vec3(0.0, 0.3, -0.5));
  }

  Round& round() { return *harness.all<Round>().at(0); }
  std::vector<Target*> targets() { return harness.all<Target>(); }
  Target& target() { return *targets().at(0); }
  int frames() const { return static_cast<int>(frames_); }

  /// Idles until a target has reached the state.
  Target& waitFor(Target::State state, int limit = 100) {
    for (int i = 0; i < limit; ++i) {
      if (!targets().empty() && target().state() == state) return target();
      idle();
    }
    throw EngineErrorForTest("no target reached the state");
  }

  /// World position of the centre of the target's hit volume.
  Vec3 hitCenter(const Target& target) const {
    return target.transform().position() + target.transform().rotation() * Vec3(0, 0, -0.015);
  }

  struct EngineErrorForTest : std::runtime_error {
    using std::runtime_error::runtime_error;
  };

  WhacAMole game;
  testing::GameHarness harness;
  Vec3 head{0.0, 1.2, 0.0};
  Pose controller;  // of the last frame

 private:
  std::int64_t period_ns_;
  std::int64_t frames_ = 0;
};

/// A player that strikes the oldest live target, from 12 cm in front of it, every few frames. Quick
/// enough for the threshold of every placement.
class ScriptedPlayer {
 public:
  void frame(WhacAMoleRound& round) {
    const Target* aim = nullptr;
    for (const Target* target : round.targets()) {
      if (target->state() == Target::State::kAlive) {
        aim = target;
        break;
      }
    }
    if (aim == nullptr) {
      round.idle();
      beat_ = 0;
      return;
    }
    const bool low = round.round().condition().placement == Placement::kLow;
    const Vec3 back = low ? Vec3(0.0, 0.12, 0.0) : Vec3(0.0, 0.0, -0.12);
    const bool strike = beat_ % 4 == 3;
    round.frameWithHead(round.hitCenter(*aim) + (strike ? Vec3(Vec3::Zero()) : back));
    ++beat_;
  }

 private:
  int beat_ = 0;
};

}  // namespace sim2vr::games::whacamole

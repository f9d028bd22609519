// SPDX-License-Identifier: Apache-2.0
// A saber in a hand: a blade rigidly on the grip, and how it moved since the frame before.
#pragma once

#include "beats/level.hpp"
#include "beats/sweep.hpp"
#include "sim2vr/core/archive.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::games::beats {

/// In the grip's frame the saber lies along +z (docs/reference/games/beats.md).
inline constexpr double kBladeRadius_m = 0.015;

inline xr::Hand controllerOf(Hand hand) {
  return hand == Hand::kLeft ? xr::Hand::left : xr::Hand::right;
}

inline Rod bladeOf(const Layout& layout) {
  return {layout.blade_start_m, layout.blade_start_m + layout.blade_length_m};
}

class Saber {
 public:
  /// `controller` outlives it.
  Saber(Hand hand, const scene::GameObject& controller, const Rod& blade)
      : hand_(hand), controller_(&controller), blade_(blade) {}

  /// Takes over where the controller is, `dt_s` after the last call.
  void follow(double dt_s);

  Hand hand() const { return hand_; }
  /// Whether the controller is on.
  bool held() const { return held_; }
  const Rod& blade() const { return blade_; }
  Segment segment() const { return segmentOf(blade_, pose_); }
  const Pose& pose() const { return pose_; }
  /// Between the last two frames; none when the controller came on in the last.
  Motion motion() const { return {last_pose_, pose_}; }
  /// As the hand moves it, of the tip, over the last frame.
  const Vec3& tipVelocity_mps() const { return tip_velocity_mps_; }
  /// Of the grip since the round's start.
  double travel_m() const { return travel_m_; }

  void fields(Archive& archive);

 private:
  Hand hand_;
  const scene::GameObject* controller_;
  Rod blade_;
  bool held_ = false;
  Pose pose_;
  Pose last_pose_;
  Vec3 tip_velocity_mps_ = Vec3::Zero();
  double travel_m_ = 0.0;
};

}  // namespace sim2vr::games::beats

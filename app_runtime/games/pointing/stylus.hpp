// SPDX-License-Identifier: Apache-2.0
// The stylus in the player's hand, and where its tip comes through the target plane.
#pragma once

#include <optional>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/scene/game_object.hpp"

namespace sim2vr::games::pointing {

/// The tip came through the plane, from the player's side.
struct Crossing {
  /// World, on the plane.
  Vec3 place_m = Vec3::Zero();
  float time_s = 0.0F;
};

class Stylus {
 public:
  /// The tip lies `length_m` in front of the grip, along its z axis. `controller` outlives it.
  Stylus(const scene::GameObject& controller, double length_m, double rearm_m)
      : controller_(&controller), length_m_(length_m), rearm_m_(rearm_m) {}

  /// Takes over where the tip is in the frame of time `time_s`, and says whether and where it came
  /// through the plane z = `plane_z_m` since the frame before: on the straight line between the two
  /// places. After each crossing it must come back by `rearm_m` in front of the plane before the
  /// next one counts.
  std::optional<Crossing> follow(float time_s, double plane_z_m);

  /// Whether the controller is on.
  bool held() const { return held_; }
  Pose tipPose() const;
  const Vec3& tip_m() const { return tip_m_; }
  /// Over the last frame.
  const Vec3& velocity_mps() const { return velocity_mps_; }
  /// Whether the next way through the plane is a selection.
  bool armed() const { return armed_; }

  void fields(Archive& archive);

 private:
  const scene::GameObject* controller_;
  double length_m_;
  double rearm_m_;
  bool held_ = false;
  bool armed_ = false;
  float time_s_ = 0.0F;
  Vec3 tip_m_ = Vec3::Zero();
  Vec3 velocity_mps_ = Vec3::Zero();
};

}  // namespace sim2vr::games::pointing

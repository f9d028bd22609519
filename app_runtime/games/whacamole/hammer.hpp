// SPDX-License-Identifier: Apache-2.0
// The hammer in the player's hand.
#pragma once

#include "sim2vr/scene/component.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "whacamole/conditions.hpp"

namespace sim2vr::games::whacamole {

/// Measures the hammer's velocity: that of its root (the pivot near the hand, not the head), per
/// frame, low-pass filtered as v <- v + 0.5 (raw - v), from 0 at the start. The settings can choose
/// the head and another factor.
class Hammer : public scene::Component {
 public:
  explicit Hammer(const Settings& settings)
      : smoothing_(settings.velocity_smoothing),
        point_(settings.velocity_point),
        hand_(settings.hand) {}

  std::string_view typeName() const override { return "whacamole.Hammer"; }
  void Update() override;
  void fields(Archive& archive) override;

  /// Smoothed velocity of the latest frame, m/s, world axes.
  const Vec3& velocity_mps() const { return velocity_; }
  /// Pose of the marker, the centre of the striking face.
  Pose markerPose() const { return marker_->transform().pose(); }
  Vec3 markerPosition() const { return marker_->transform().position(); }

  void setMarker(const scene::GameObject& marker) { marker_ = &marker; }

 private:
  Vec3 measuredPoint() const;

  double smoothing_;
  VelocityPoint point_;
  xr::Hand hand_;
  const scene::GameObject* marker_ = nullptr;
  Vec3 velocity_ = Vec3::Zero();
  Vec3 last_position_ = Vec3::Zero();
  bool has_position_ = false;
};

/// Builds hammer, marker and hit collider below the controller of the hand of the settings.
Hammer& buildHammer(scene::GameObject& controller, const Settings& settings);

}  // namespace sim2vr::games::whacamole

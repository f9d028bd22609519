// SPDX-License-Identifier: Apache-2.0
// A hand on the panel: where it points, and whether it holds what it points at.
#pragma once

#include "panel/settings.hpp"
#include "sim2vr/core/archive.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::panel {

/// From the grip to the fingertip, along the controller's forward axis.
inline constexpr double kFinger_m = 0.10;

/// The actions that both hands have; made before the rig attaches all action sets.
struct Controls {
  const xr::Action* aim = nullptr;
  const xr::Action* trigger = nullptr;
  const xr::Action* squeeze = nullptr;
  const xr::Action* scroll = nullptr;
  const xr::Action* vibrate = nullptr;

  static Controls make(xr::Session& session);
};

/// What a hand does in a frame.
struct PointerState {
  /// The hand is tracked.
  bool active = false;
  /// The ray meets the panel's plane, or the fingertip is near it.
  bool on_plane = false;
  /// There, from the panel's centre; z is 0.
  Vec3 place_m = Vec3::Zero();
  /// World: where the ray begins and which way it goes; or the fingertip, and ahead of it.
  Vec3 origin_m = Vec3::Zero();
  Vec3 forward = Vec3::UnitZ();
  /// The trigger or the grip button is pulled; or the fingertip has come through the plane.
  bool held = false;
  /// `held` began, or ended, in this frame.
  bool pressed = false;
  bool released = false;
  /// Of the controller about its forward axis, rad, clockwise for the player.
  double roll_rad = 0.0;
  /// Thumbstick, up positive, -1 to 1.
  double scroll = 0.0;

  void fields(Archive& archive);
};

class Pointer {
 public:
  /// What is passed outlives it.
  Pointer(const scene::GameObject& controller, xr::Hand hand, xr::Session& session,
          const Controls& controls, Select select)
      : controller_(&controller),
        hand_(hand),
        session_(&session),
        controls_(controls),
        select_(select) {}

  xr::Hand hand() const { return hand_; }
  const PointerState& state() const { return state_; }

  /// Looks at the hand, in every frame; the panel's centre, world.
  void update(const Vec3& center_m);
  /// A pulse of 20 ms.
  void vibrate() const;
  /// How far it is from pointing at a place, world: an angle, rad, or a distance, m.
  double gap(const Vec3& place_m) const;

  void fields(Archive& archive) {
    archive.field("state", state_);
    archive.field("in_front", in_front_);
  }

 private:
  void updateRay(const Vec3& center_m);
  void updateTouch(const Vec3& center_m);

  const scene::GameObject* controller_;
  xr::Hand hand_;
  xr::Session* session_;
  Controls controls_;
  Select select_;
  PointerState state_;
  /// The fingertip has been on the player's side of the plane since it last came through.
  bool in_front_ = false;
};

}  // namespace sim2vr::games::panel

// SPDX-License-Identifier: Apache-2.0
// The player's rig: head camera and controllers, moved by what the XR session tracks.
#pragma once

#include <string_view>

#include "sim2vr/rl/game.hpp"
#include "sim2vr/scene/component.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::rl {

// Where the runtime finds the cameras and the controllers of a round.
inline constexpr std::string_view kHeadCameraPath = "XR Rig/Main Camera";
inline constexpr std::string_view kLeftControllerPath = "XR Rig/LeftHand Controller";
inline constexpr std::string_view kRightControllerPath = "XR Rig/RightHand Controller";
inline constexpr std::string_view kThirdPersonCameraPath = "Third Person Camera";
inline constexpr std::string_view kSpectatorCameraPath = "Spectator Camera";

/// Layer of what stands for the player in pictures from outside. The head camera leaves it out.
inline constexpr int kPlayerLooksLayer = 31;

/// The rig's action set in the session, with the pose action of both hands.
inline constexpr std::string_view kRigActionSet = "xr_rig";
inline constexpr std::string_view kGripAction = "grip_pose";

/// Of the head camera; the defaults are what simulated users see. How wide it sees is the
/// session's to say (xr::SessionSettings).
struct XrRigSettings {
  double near_m = 0.01;
  double far_m = 10.0;
};

/// The objects of "XR Rig". World = tracking space (STAGE, floor origin).
struct XrRig {
  scene::GameObject* root = nullptr;
  scene::GameObject* camera = nullptr;            // "Main Camera", with "Headset" below it
  scene::GameObject* left_controller = nullptr;   // "LeftHand Controller"
  scene::GameObject* right_controller = nullptr;  // "RightHand Controller"
};

/// Moves one object of the rig to where its space is in STAGE, before the game's own components
/// run. An object whose space is not tracked is switched off until it is again, with everything
/// below it; it keeps its last pose. Lives on the rig's root.
class TrackedPoseDriver : public scene::Component {
 public:
  static constexpr int kExecutionOrder = -50;

  TrackedPoseDriver(xr::Session& session, const xr::Space& space, scene::GameObject& moved)
      : session_(session), space_(space), moved_(moved) {}

  std::string_view typeName() const override { return "TrackedPoseDriver"; }
  int executionOrder() const override { return kExecutionOrder; }
  void Update() override;

 private:
  xr::Session& session_;
  xr::Space space_;
  scene::GameObject& moved_;
};

/// Builds the rig, with a headset for outside cameras to see (kPlayerLooksLayer). In a session
/// without attached action sets it makes the rig's set and attaches all sets, so that a game with
/// actions of its own makes those first. Controllers follow their grip pose. Throws StateError when
/// the session's sets are attached and the rig's is not among them.
XrRig buildXrRig(GameContext& context, const XrRigSettings& settings = {});

}  // namespace sim2vr::rl

// SPDX-License-Identifier: Apache-2.0
// The devices: a head-mounted display and two hand controllers.
#pragma once

#include <openxr/openxr.h>

#include <array>
#include <cstddef>
#include <string>
#include <string_view>

#include "sim2vr/core/archive.hpp"

namespace sim2vr::xr {

enum class Hand { left = 0, right = 1 };
inline constexpr std::array<Hand, 2> kHands{Hand::left, Hand::right};

inline constexpr XrPosef kIdentityPose{{0.0F, 0.0F, 0.0F, 1.0F}, {0.0F, 0.0F, 0.0F}};

/// The pose that a Touch controller's aim has in its grip frame: the ray leaves the controller
/// tilted 60 degrees downwards from the grip's z axis (rotation of -60 degrees about +x in OpenXR's
/// frame). Our convention for devices that track the grip only; recordings bring both poses.
inline constexpr XrPosef kGripToAim{{-0.5F, 0.0F, 0.0F, 0.86602540F}, {0.0F, 0.0F, 0.0F}};

/// One controller of Oculus-Touch shape. All poses are in STAGE space, OpenXR's frame (frames.hpp).
struct ControllerState {
  bool active = false;
  XrPosef grip = kIdentityPose;
  XrPosef aim = kIdentityPose;
  float trigger = 0.0F;               // 0 .. 1
  float squeeze = 0.0F;               // 0 .. 1
  XrVector2f thumbstick{0.0F, 0.0F};  // -1 .. 1 each; +y away from the user
  bool thumbstick_click = false;
  bool a = false;     // right controller only
  bool b = false;     // right controller only
  bool x = false;     // left controller only
  bool y = false;     // left controller only
  bool menu = false;  // left controller only
  // Capacitive sensors: a finger rests on it.
  bool trigger_touch = false;
  bool thumbstick_touch = false;
  bool lower_touch = false;  // on X (left) or A (right)
  bool upper_touch = false;  // on Y (left) or B (right)
  bool thumbrest_touch = false;

  void fields(Archive& archive);
};

struct DeviceState {
  XrPosef head = kIdentityPose;  // centre between the eyes, in STAGE
  std::array<ControllerState, 2> hands{};

  ControllerState& hand(Hand hand) { return hands[static_cast<std::size_t>(hand)]; }
  const ControllerState& hand(Hand hand) const { return hands[static_cast<std::size_t>(hand)]; }

  void fields(Archive& archive);
};

/// A vibration that the app asked for.
struct HapticPulse {
  Hand hand = Hand::right;
  float amplitude = 0.0F;       // 0 .. 1; 0 stops the hand's vibration
  float frequency_hz = 0.0F;    // 0 (XR_FREQUENCY_UNSPECIFIED): the device's own choice
  XrDuration duration_ns = -1;  // -1 (XR_MIN_HAPTIC_DURATION): the shortest the device can
};

/// `a * b`: the pose of `b`, given in the frame that has pose `a`.
XrPosef compose(const XrPosef& a, const XrPosef& b);
XrPosef inverse(const XrPosef& pose);

/// The state with its rotations normalised (those that are already, to binary32, keep their bits).
/// Throws InvalidArgument naming the value, such as
/// "right_controller.rotation", when a number is not finite, a quaternion's length differs from 1
/// by more than 1e-3, or an analogue input is outside its range. Of an inactive controller nothing
/// is checked and nothing kept.
DeviceState validated(const DeviceState& state);

}  // namespace sim2vr::xr

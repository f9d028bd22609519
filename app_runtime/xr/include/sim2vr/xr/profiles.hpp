// SPDX-License-Identifier: Apache-2.0
// Interaction profiles: which inputs and outputs a controller has, and which of the simulated
// controller's stands for each.
#pragma once

#include <openxr/openxr.h>

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/xr/device.hpp"

namespace sim2vr::xr {

/// What of a simulated controller an input reads. `none`: the profile has it, we do not.
enum class Input : std::uint8_t {
  none,
  grip_pose,
  aim_pose,
  haptic,
  trigger,
  trigger_touch,
  squeeze,
  stick,
  stick_x,
  stick_y,
  stick_click,
  stick_touch,
  lower,
  lower_touch,
  upper,
  upper_touch,
  menu,
  thumbrest_touch
};

enum class InputKind : std::uint8_t { boolean, number, vector, pose, haptic };

/// One path of a profile, such as /user/hand/left/input/trigger/value.
struct Component {
  std::string path;
  std::string source;        // without the component: /user/hand/left/input/trigger
  std::optional<Hand> hand;  // nothing: of another device, which nothing here moves
  Input input = Input::none;
  InputKind kind = InputKind::boolean;
};

struct Profile {
  std::string path;
  std::string localized_name;
  bool since_11 = false;
  std::vector<Component> components;

  /// nullptr: it has no such path. A path without component stands for the fitting one
  /// (trigger: trigger/value).
  const Component* find(std::string_view binding) const;
};

/// The hand that a path begins with; nothing: neither.
std::optional<Hand> handOf(std::string_view path);

const std::vector<Profile>& profiles();
const Profile* findProfile(std::string_view path);

/// Whether an action of this type can be bound to it.
bool fits(InputKind kind, XrActionType type);
/// Value of an input for an action; a number presses a button from 0.5 on.
XrVector2f readInput(const Component& component, XrActionType type, const ControllerState& hand);

}  // namespace sim2vr::xr

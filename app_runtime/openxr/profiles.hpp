// Interaction profiles: which inputs and outputs a controller has, and which of the simulated
// controller's stands for each.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "api.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::openxr {

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
  std::string source;  // without the component: /user/hand/left/input/trigger
  int hand = 2;        // 0 left, 1 right, 2 neither
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

const std::vector<Profile>& profiles();
const Profile* findProfile(std::string_view path);

/// Whether an action of this type can be bound to it.
bool fits(InputKind kind, XrActionType type);
/// Value of an input for an action; a number presses a button above 0.5.
XrVector2f readInput(const Component& component, XrActionType type,
                     const xr::ControllerState& hand);

}  // namespace sim2vr::openxr

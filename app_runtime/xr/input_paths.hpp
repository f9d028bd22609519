// The inputs and outputs of the simulated controllers: the Oculus Touch profile's, as far as a
// ControllerState has them.
#pragma once

#include <openxr/openxr.h>

#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/xr/device.hpp"

namespace sim2vr::xr {

enum class InputKind { button, analogue, stick, grip_pose, aim_pose, haptic };

struct InputPath {
  std::string path;
  Hand hand;
  InputKind kind;
  /// Value of an input that has one; buttons and one-dimensional inputs use x.
  XrVector2f (*read)(const ControllerState&);

  /// Whether an action of this type may be bound to it.
  bool fits(XrActionType type) const;
};

/// nullptr for an unknown path. "/user/hand/<hand>/input/trigger" stands for ".../trigger/value",
/// and so for the other inputs with a single component.
const InputPath* findInputPath(std::string_view path);

}  // namespace sim2vr::xr

// SPDX-License-Identifier: Apache-2.0
// A device that plays a timeline: for demonstrations, tests and recorded input.
#pragma once

#include <string_view>
#include <vector>

#include "sim2vr/xr/device.hpp"

namespace sim2vr::xr {

struct Keyframe {
  XrTime time = 0;  // ns after the timeline's start
  DeviceState state;
};

/// Between two keyframes positions and analogue inputs move linearly and rotations by slerp (the
/// short way round); buttons and the active flags keep the earlier keyframe's value. Before the
/// first and after the last keyframe the nearest one holds.
class ScriptedDevice {
 public:
  /// Throws InvalidArgument ("keyframes" or a value's name) when the list is empty, times do not
  /// grow, or validated() refuses a state.
  explicit ScriptedDevice(std::vector<Keyframe> keyframes);

  /// Reads
  ///   {"keyframes": [{"time_s": 0.0,
  ///                   "head": {"position": [x, y, z], "rotation": [x, y, z, w]},
  ///                   "left_controller": {...},
  ///                   "right_controller": {"active": true, "position": [...], "rotation": [...],
  ///                      "aim_position": [...], "aim_rotation": [...], "trigger": 0.0, "squeeze":
  ///                      0.0, "thumbstick": [0, 0], "thumbstick_click": false, "a": false, "b":
  ///                      false}}]}
  /// Poses are in STAGE, OpenXR's frame. What a keyframe leaves out keeps the previous keyframe's
  /// value; a controller that is mentioned is active unless it says otherwise; an aim never given
  /// is grip * kGripToAim. Throws InvalidArgument naming the entry, such as
  /// "keyframes[2].head.position".
  static ScriptedDevice fromJson(std::string_view text);

  /// The devices at a time, ns after the timeline's start.
  DeviceState sample(XrTime time) const;

 private:
  std::vector<Keyframe> keyframes_;
};

}  // namespace sim2vr::xr

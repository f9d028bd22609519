// SPDX-License-Identifier: Apache-2.0
// Poses and inputs as they come from outside (arrays, messages, logs). A pose is a row of 7
// binary64 numbers, position x y z in metres and rotation x y z w, in the app's frame; the inputs
// of one controller are a row of 13.
#pragma once

#include <array>
#include <string_view>

#include "sim2vr/core/math.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::xr {

inline constexpr int kPoseRowNumbers = 7;

/// Columns of a row of inputs, with the name each has on the left and on the right controller
/// ("left.x" is column 5 of the left row, "right.a" that of the right one); "" where that
/// controller has none. Columns 0 to 3 are analogue (0 .. 1, thumbstick -1 .. 1), the others are 0
/// or 1.
struct InputColumn {
  std::string_view left;
  std::string_view right;
};
inline constexpr std::array<InputColumn, 13> kInputColumns{
    {{"trigger", "trigger"},
     {"squeeze", "squeeze"},
     {"thumbstick_x", "thumbstick_x"},
     {"thumbstick_y", "thumbstick_y"},
     {"thumbstick_click", "thumbstick_click"},
     {"x", "a"},
     {"y", "b"},
     {"menu", ""},
     {"trigger_touch", "trigger_touch"},
     {"thumbstick_touch", "thumbstick_touch"},
     {"x_touch", "a_touch"},
     {"y_touch", "b_touch"},
     {"thumbrest_touch", "thumbrest_touch"}}};
inline constexpr int kInputRowNumbers = static_cast<int>(kInputColumns.size());

/// The inputs of a controller; null: at rest. Analogue values are not checked (see validated()).
/// Throws InvalidArgument naming the input, such as "right_controller.a", when a button is neither
/// 0 nor 1 or the controller has no such input.
ControllerState inputsFromRow(Hand hand, const double* row);

Pose poseFromRow(const double* row);

/// What the session reads when head and controllers are tracked as given. Null: a controller that
/// is not tracked. Every way into the runtime comes through here, so that the same numbers give the
/// same bits. `inputs` are the analogue and digital inputs of the tracked controllers, by Hand;
/// aim is grip * kGripToAim. Nothing is checked: see validated().
DeviceState devicesFromRows(const double* head, const double* left, const double* right,
                            const std::array<ControllerState, 2>& inputs = {});

}  // namespace sim2vr::xr

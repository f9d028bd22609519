// Poses as they come from outside (arrays, messages, logs): rows of 7 binary64 numbers, position
// x y z in metres and rotation x y z w, in the app's frame.
#pragma once

#include <array>

#include "sim2vr/core/math.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::xr {

inline constexpr int kPoseRowNumbers = 7;

Pose poseFromRow(const double* row);

/// What the session reads when head and controllers are tracked as given. Null: a controller that
/// is not tracked. Every way into the runtime comes through here, so that the same numbers give the
/// same bits. `inputs` are the analogue and digital inputs of the tracked controllers, by Hand;
/// aim is grip * kGripToAim. Nothing is checked: see validated().
DeviceState devicesFromRows(const double* head, const double* left, const double* right,
                            const std::array<ControllerState, 2>& inputs = {});

}  // namespace sim2vr::xr

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/xr/pose_row.hpp"

#include <sstream>
#include <string>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/xr/frames.hpp"

namespace sim2vr::xr {
namespace {

ControllerState controller(ControllerState inputs, const double* row) {
  if (row == nullptr) return {};
  inputs.active = true;
  inputs.grip = toXr(poseFromRow(row));
  inputs.aim = compose(inputs.grip, kGripToAim);
  return inputs;
}

bool pressed(Hand hand, const double* row, std::size_t column) {
  const double value = row[column];
  const bool left = hand == Hand::left;
  const std::string_view name = left ? kInputColumns[column].left : kInputColumns[column].right;
  if (value == 0.0) return false;
  if (value == 1.0 && !name.empty()) return true;
  std::ostringstream got;
  got << value;
  if (name.empty()) {
    throw InvalidArgument("right_controller.menu", got.str(), "0: the right controller has none");
  }
  throw InvalidArgument((left ? "left_controller." : "right_controller.") + std::string(name),
                        got.str(), "0 or 1");
}

}  // namespace

ControllerState inputsFromRow(Hand hand, const double* row) {
  ControllerState state;
  if (row == nullptr) return state;
  state.trigger = static_cast<float>(row[0]);
  state.squeeze = static_cast<float>(row[1]);
  state.thumbstick = {static_cast<float>(row[2]), static_cast<float>(row[3])};
  state.thumbstick_click = pressed(hand, row, 4);
  (hand == Hand::left ? state.x : state.a) = pressed(hand, row, 5);
  (hand == Hand::left ? state.y : state.b) = pressed(hand, row, 6);
  state.menu = pressed(hand, row, 7);
  state.trigger_touch = pressed(hand, row, 8);
  state.thumbstick_touch = pressed(hand, row, 9);
  state.lower_touch = pressed(hand, row, 10);
  state.upper_touch = pressed(hand, row, 11);
  state.thumbrest_touch = pressed(hand, row, 12);
  return state;
}

Pose poseFromRow(const double* row) {
  return {Vec3(row[0], row[1], row[2]), Quat(row[6], row[3], row[4], row[5])};
}

DeviceState devicesFromRows(const double* head, const double* left, const double* right,
                            const std::array<ControllerState, 2>& inputs) {
  DeviceState state;
  state.head = toXr(poseFromRow(head));
  state.hand(Hand::left) = controller(inputs[static_cast<std::size_t>(Hand::left)], left);
  state.hand(Hand::right) = controller(inputs[static_cast<std::size_t>(Hand::right)], right);
  return state;
}

}  // namespace sim2vr::xr

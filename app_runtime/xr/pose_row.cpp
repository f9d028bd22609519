#include "sim2vr/xr/pose_row.hpp"

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

}  // namespace

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

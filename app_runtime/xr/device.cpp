// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/xr/device.hpp"

#include <cmath>

#include "sim2vr/core/errors.hpp"
#include "xr_archive.hpp"

namespace sim2vr::xr {
namespace {

constexpr double kLengthTolerance = 1e-3;
// A unit quaternion rounded to binary32 is this far from length 1 at most. It is left as it is, so
// that poses read back from a log are the ones that were logged.
constexpr double kRoundedLength = 2.5e-7;

// Products are formed in double precision, so that chains of binary32 poses lose nothing visible.
Quat toQuat(const XrQuaternionf& q) { return {q.w, q.x, q.y, q.z}; }
Vec3 toVec(const XrVector3f& v) { return {v.x, v.y, v.z}; }

XrPosef toPosef(const Quat& q, const Vec3& p) {
  return {{static_cast<float>(q.x()), static_cast<float>(q.y()), static_cast<float>(q.z()),
           static_cast<float>(q.w())},
          {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())}};
}

std::string print(const XrQuaternionf& q) {
  return "(" + std::to_string(q.x) + ", " + std::to_string(q.y) + ", " + std::to_string(q.z) +
         ", " + std::to_string(q.w) + ")";
}

bool isIdentity(const XrPosef& pose) {
  return toQuat(pose.orientation).coeffs() == Quat::Identity().coeffs() &&
         toVec(pose.position) == Vec3::Zero();
}

XrPosef validPose(const std::string& name, const XrPosef& pose) {
  const Vec3 position = toVec(pose.position);
  if (!position.allFinite()) {
    throw InvalidArgument(name + "position", "a number that is not finite", "metres");
  }
  const Quat rotation = toQuat(pose.orientation);
  const double length = rotation.coeffs().norm();
  if (!(std::abs(length - 1.0) <= kLengthTolerance)) {
    throw InvalidArgument(name + "rotation", print(pose.orientation),
                          "a unit quaternion x y z w (length 1 within 0.001)");
  }
  if (std::abs(length - 1.0) <= kRoundedLength) return pose;
  return toPosef(rotation.normalized(), position);
}

void requireRange(const std::string& name, float value, float low, float high) {
  if (!(value >= low && value <= high)) {
    throw InvalidArgument(name, std::to_string(value),
                          "a number from " + std::to_string(static_cast<int>(low)) + " to " +
                              std::to_string(static_cast<int>(high)));
  }
}

ControllerState validController(const std::string& name, const ControllerState& state) {
  if (!state.active) return {};
  ControllerState valid = state;
  valid.grip = validPose(name + ".", state.grip);
  valid.aim = validPose(name + ".aim_", state.aim);
  requireRange(name + ".trigger", state.trigger, 0.0F, 1.0F);
  requireRange(name + ".squeeze", state.squeeze, 0.0F, 1.0F);
  requireRange(name + ".thumbstick.x", state.thumbstick.x, -1.0F, 1.0F);
  requireRange(name + ".thumbstick.y", state.thumbstick.y, -1.0F, 1.0F);
  return valid;
}

}  // namespace

void ControllerState::fields(Archive& archive) {
  archive.field("active", active);
  poseField(archive, "grip", grip);
  poseField(archive, "aim", aim);
  archive.field("trigger", trigger);
  archive.field("squeeze", squeeze);
  vectorField(archive, "thumbstick", thumbstick);
  const std::array<bool*, 11> buttons{&thumbstick_click,
                                      &a,
                                      &b,
                                      &x,
                                      &y,
                                      &menu,
                                      &trigger_touch,
                                      &thumbstick_touch,
                                      &lower_touch,
                                      &upper_touch,
                                      &thumbrest_touch};
  std::array<bool, 11> pressed{};
  for (std::size_t i = 0; i < buttons.size(); ++i) pressed[i] = *buttons[i];
  archive.field("buttons", pressed);
  for (std::size_t i = 0; i < buttons.size(); ++i) *buttons[i] = pressed[i];
}

void DeviceState::fields(Archive& archive) {
  poseField(archive, "head", head);
  archive.field("hands", hands);
}

XrPosef compose(const XrPosef& a, const XrPosef& b) {
  // The identity changes no bit of the other.
  if (isIdentity(a)) return b;
  if (isIdentity(b)) return a;
  const Quat rotation = toQuat(a.orientation);
  return toPosef((rotation * toQuat(b.orientation)).normalized(),
                 toVec(a.position) + rotation * toVec(b.position));
}

XrPosef inverse(const XrPosef& pose) {
  const Quat back = toQuat(pose.orientation).conjugate();
  return toPosef(back, -(back * toVec(pose.position)));
}

DeviceState validated(const DeviceState& state) {
  DeviceState valid;
  valid.head = validPose("head.", state.head);
  valid.hand(Hand::left) = validController("left_controller", state.hand(Hand::left));
  valid.hand(Hand::right) = validController("right_controller", state.hand(Hand::right));
  return valid;
}

}  // namespace sim2vr::xr

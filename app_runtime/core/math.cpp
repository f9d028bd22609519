// SPDX-License-Identifier: Apache-2.0
// Compiled once: Eigen's code of these takes seconds in every source that has it.
#include "sim2vr/core/math.hpp"

namespace sim2vr {

Quat lookAlong(const Vec3& direction) {
  const Vec3 forward = direction.normalized();
  const Vec3 right = Vec3::UnitY().cross(forward).normalized();
  Eigen::Matrix3d axes;
  axes << right, forward.cross(right), forward;
  return Quat(axes);
}

Quat rotationBetween(const Vec3& from, const Vec3& to) { return Quat::FromTwoVectors(from, to); }

}  // namespace sim2vr

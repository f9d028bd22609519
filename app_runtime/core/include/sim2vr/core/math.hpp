// SPDX-License-Identifier: Apache-2.0
// Vectors, rotations and poses. Scene quantities are double precision, metres, in the app's frame:
// Unity's convention, left-handed, x right, y up, z forward; quaternions rotate local to world.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace sim2vr {

using Vec3 = Eigen::Vector3d;
using Quat = Eigen::Quaterniond;

/// Rotation that turns z (forward) along `direction` and keeps x level; not for straight up or
/// down.
Quat lookAlong(const Vec3& direction);

/// The shortest rotation that turns one direction into another.
Quat rotationBetween(const Vec3& from, const Vec3& to);

/// Rigid pose a_T_b: maps coordinates of frame b to frame a. Position in metres.
struct Pose {
  Vec3 position = Vec3::Zero();
  Quat rotation = Quat::Identity();

  Vec3 operator*(const Vec3& point) const { return position + rotation * point; }
  Pose operator*(const Pose& other) const {
    return {position + rotation * other.position, rotation * other.rotation};
  }
  Pose inverse() const {
    const Quat inverse_rotation = rotation.conjugate();
    return {-(inverse_rotation * position), inverse_rotation};
  }
  bool isFinite() const { return position.allFinite() && rotation.coeffs().allFinite(); }
};

}  // namespace sim2vr

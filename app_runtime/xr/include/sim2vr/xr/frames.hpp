// SPDX-License-Identifier: Apache-2.0
// The only place where the app's frame and OpenXR's meet. The app's frame is Unity's: left-handed,
// x right, y up, z forward. OpenXR's is right-handed: x right, y up, z backward. Both have the same
// floor origin (STAGE), so that a conversion only flips signs:
//   position (x, y, z) <-> (x, y, -z)     rotation (x, y, z, w) <-> (-x, -y, z, w)
// OpenXR stores binary32. xr -> app -> xr is exact; app -> xr rounds each number once, which is the
// documented precision of tracked poses.
#pragma once

#include <openxr/openxr.h>

#include "sim2vr/core/math.hpp"

namespace sim2vr::xr {

inline XrVector3f toXr(const Vec3& unity) {
  return {static_cast<float>(unity.x()), static_cast<float>(unity.y()),
          -static_cast<float>(unity.z())};
}

inline XrQuaternionf toXr(const Quat& unity) {
  return {-static_cast<float>(unity.x()), -static_cast<float>(unity.y()),
          static_cast<float>(unity.z()), static_cast<float>(unity.w())};
}

/// A pose in the app's frame as an OpenXR pose. Position in metres.
inline XrPosef toXr(const Pose& unity) { return {toXr(unity.rotation), toXr(unity.position)}; }

inline Vec3 fromXr(const XrVector3f& xr) { return {xr.x, xr.y, -static_cast<double>(xr.z)}; }

inline Quat fromXr(const XrQuaternionf& xr) {
  return {xr.w, -static_cast<double>(xr.x), -static_cast<double>(xr.y), xr.z};
}

/// An OpenXR pose in the app's frame. Position in metres.
inline Pose fromXr(const XrPosef& xr) { return {fromXr(xr.position), fromXr(xr.orientation)}; }

}  // namespace sim2vr::xr

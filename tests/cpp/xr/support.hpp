// SPDX-License-Identifier: Apache-2.0
// Devices and poses of the tests, and shorthands.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "error_of.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::xr {

inline ControllerState activeController() {
  ControllerState state;
  state.active = true;
  return state;
}

/// The right hand alone, with its trigger pulled so far.
inline DeviceState pulled(float trigger) {
  DeviceState state;
  state.hand(Hand::right) = activeController();
  state.hand(Hand::right).trigger = trigger;
  return state;
}

inline void expectPose(const XrPosef& got, const XrPosef& expected, float tolerance = 1e-6F) {
  EXPECT_NEAR(got.position.x, expected.position.x, tolerance);
  EXPECT_NEAR(got.position.y, expected.position.y, tolerance);
  EXPECT_NEAR(got.position.z, expected.position.z, tolerance);
  const XrQuaternionf& a = got.orientation;
  const XrQuaternionf& b = expected.orientation;
  const float dot = a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w;
  EXPECT_NEAR(std::abs(dot), 1.0F, tolerance)
      << a.x << " " << a.y << " " << a.z << " " << a.w << " is another rotation";
}

}  // namespace sim2vr::xr

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/xr/frames.hpp"
#include "sim2vr/xr/pose_row.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>

namespace sim2vr::xr {
namespace {

TEST(Frames, SignsOfPositionAndRotation) {
  const XrPosef xr = toXr(Pose{Vec3(1, 2, 3), Quat(0.1, 0.2, 0.3, 0.4)});  // w, x, y, z
  EXPECT_EQ(xr.position.x, 1.0F);
  EXPECT_EQ(xr.position.y, 2.0F);
  EXPECT_EQ(xr.position.z, -3.0F);
  EXPECT_EQ(xr.orientation.x, -0.2F);
  EXPECT_EQ(xr.orientation.y, -0.3F);
  EXPECT_EQ(xr.orientation.z, 0.4F);
  EXPECT_EQ(xr.orientation.w, 0.1F);
}

// Unity's turn to the right (yaw +90 degrees: forward z becomes x) is OpenXR's -90 degrees about y
// (forward -z becomes x).
TEST(Frames, TurnToTheRight) {
  const float half = std::sqrt(0.5F);
  const Quat unity(half, 0, half, 0);
  EXPECT_LT((unity * Vec3::UnitZ() - Vec3::UnitX()).norm(), 1e-6);
  const XrQuaternionf xr = toXr(unity);
  EXPECT_EQ(xr.y, -half);
  const Quat right_handed(xr.w, xr.x, xr.y, xr.z);
  EXPECT_LT((right_handed * Vec3(0, 0, -1) - Vec3::UnitX()).norm(), 1e-6);
}

// Rotating a vector and flipping frames commute: for any rotation, not only special ones.
TEST(Frames, RotationAndFlipCommute) {
  std::mt19937_64 bits(1);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 100; ++i) {
    const Quat unity = Quat(normal(bits), normal(bits), normal(bits), normal(bits)).normalized();
    const Vec3 v(normal(bits), normal(bits), normal(bits));
    const XrQuaternionf q = toXr(unity);
    const Quat xr(q.w, q.x, q.y, q.z);
    const Vec3 rotated = unity * v;
    const Vec3 in_xr = xr * Vec3(v.x(), v.y(), -v.z());
    EXPECT_LT((in_xr - Vec3(rotated.x(), rotated.y(), -rotated.z())).norm(), 1e-6);
  }
}

TEST(Frames, RoundTripIsExact) {
  std::mt19937_64 bits(2);
  std::normal_distribution<float> normal;
  for (int i = 0; i < 1000; ++i) {
    const XrPosef xr{{normal(bits), normal(bits), normal(bits), normal(bits)},
                     {normal(bits), normal(bits), normal(bits)}};
    const XrPosef back = toXr(fromXr(xr));
    EXPECT_EQ(std::memcmp(&back, &xr, sizeof(xr)), 0);
  }
}

TEST(Frames, DevicesFromRowsOfNumbers) {
  constexpr double kHead[] = {1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8};
  constexpr double kRight[] = {4.0, 5.0, 6.0, 0.6, 0.0, 0.0, 0.8};
  std::array<ControllerState, 2> inputs;
  inputs[0].trigger = 0.25F;
  inputs[1].a = true;
  const DeviceState state = devicesFromRows(kHead, nullptr, kRight, inputs);
  EXPECT_EQ(state.head.position.z, -3.0F);
  EXPECT_EQ(state.head.orientation.z, 0.6F);
  EXPECT_EQ(state.head.orientation.w, 0.8F);
  // A controller that is not tracked has no inputs either.
  EXPECT_FALSE(state.hand(Hand::left).active);
  EXPECT_EQ(state.hand(Hand::left).trigger, 0.0F);
  const ControllerState& right = state.hand(Hand::right);
  EXPECT_TRUE(right.active);
  EXPECT_TRUE(right.a);
  EXPECT_EQ(right.grip.position.x, 4.0F);
  EXPECT_EQ(right.grip.orientation.x, -0.6F);
  // The aim is turned by -60 degrees about x: -0.6 cos 30 - 0.8 sin 30.
  EXPECT_NEAR(right.aim.orientation.x, -0.6 * std::cos(M_PI / 6) - 0.4, 1e-6);
}

TEST(Frames, DoublesAreRoundedOnce) {
  EXPECT_EQ(toXr(Vec3(0.1, 0.2, 0.3)).z, -0.3F);
  EXPECT_EQ(fromXr(toXr(Vec3(0.1, 0.2, 0.3))).x(), static_cast<double>(0.1F));
}

}  // namespace
}  // namespace sim2vr::xr

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/math.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace sim2vr {
namespace {

// A quarter turn about y takes z to x in the app's left-handed frame as in any other.
const Quat kQuarterTurnY(std::sqrt(0.5), 0.0, std::sqrt(0.5), 0.0);

TEST(Pose, MapsPoints) {
  const Pose world_T_hand{Vec3(1, 2, 3), kQuarterTurnY};
  EXPECT_TRUE((world_T_hand * Vec3(0, 0, 1)).isApprox(Vec3(2, 2, 3), 1e-15));
  EXPECT_TRUE((world_T_hand * Vec3(1, 0, 0)).isApprox(Vec3(1, 2, 2), 1e-15));
}

TEST(Pose, ChainsAndInverts) {
  const Pose a{Vec3(1, 2, 3), kQuarterTurnY};
  const Pose b{Vec3(0, 0, 1), kQuarterTurnY};
  const Pose ab = a * b;
  EXPECT_TRUE(ab.position.isApprox(Vec3(2, 2, 3), 1e-15));
  EXPECT_TRUE((ab.rotation * Vec3::UnitZ()).isApprox(-Vec3::UnitZ(), 1e-15));
  const Pose back = ab * ab.inverse();
  EXPECT_LT(back.position.norm(), 1e-14);
  EXPECT_LT(back.rotation.angularDistance(Quat::Identity()), 1e-7);
}

TEST(Pose, FiniteMeansAllSevenNumbers) {
  Pose pose;
  EXPECT_TRUE(pose.isFinite());
  pose.position.y() = std::nan("");
  EXPECT_FALSE(pose.isFinite());
  pose = {};
  pose.rotation.w() = INFINITY;
  EXPECT_FALSE(pose.isFinite());
}

}  // namespace
}  // namespace sim2vr

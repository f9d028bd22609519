// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>

#include "sim2vr/rl/view_frustum.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::rl {
namespace {

class ViewFrustum : public ::testing::Test {
 protected:
  ViewFrustum()
      : object_(scene_.create("Camera")), camera_(object_.addComponent<render::Camera>()) {}

  bool sees(const Vec3& point_m) const { return inView(camera_, 1.5, point_m); }

  scene::Scene scene_;
  scene::GameObject& object_;
  render::Camera& camera_;
};

// 90 degrees from top to bottom: as high as far away; 1.5 times as wide.
TEST_F(ViewFrustum, EndsWithTheAngles) {
  EXPECT_TRUE(sees({0.0, 0.99, 1.0}));
  EXPECT_FALSE(sees({0.0, 1.01, 1.0}));
  EXPECT_TRUE(sees({0.0, -0.99, 1.0}));
  EXPECT_FALSE(sees({0.0, -1.01, 1.0}));
  EXPECT_TRUE(sees({1.49, 0.0, 1.0}));
  EXPECT_FALSE(sees({1.51, 0.0, 1.0}));
  EXPECT_TRUE(sees({-2.98, 0.0, 2.0}));
  EXPECT_FALSE(sees({-3.02, 0.0, 2.0}));
}

TEST_F(ViewFrustum, EndsWithTheClippingPlanes) {
  EXPECT_FALSE(sees({0.0, 0.0, -1.0}));
  EXPECT_FALSE(sees({0.0, 0.0, 0.009}));
  EXPECT_TRUE(sees({0.0, 0.0, 0.011}));
  EXPECT_TRUE(sees({0.0, 0.0, 9.9}));
  EXPECT_FALSE(sees({0.0, 0.0, 10.1}));
}

// A quarter turn to the right: what was in front is at the left edge, 90 degrees off.
TEST_F(ViewFrustum, MovesWithTheCamera) {
  object_.transform().setPose(
      {Vec3(1.0, 1.0, 1.0), Quat(std::sqrt(0.5), 0.0, std::sqrt(0.5), 0.0)});
  EXPECT_TRUE(sees({3.0, 1.0, 1.0}));
  EXPECT_FALSE(sees({1.0, 1.0, 3.0}));
  // To its right is the world's -z.
  EXPECT_TRUE(sees({2.0, 1.0, -0.49}));
  EXPECT_FALSE(sees({2.0, 1.0, -0.51}));
}

}  // namespace
}  // namespace sim2vr::rl

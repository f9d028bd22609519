// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/scene/transform.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "sim2vr/scene/scene.hpp"

namespace sim2vr::scene {
namespace {

const Quat kQuarterTurnY(std::sqrt(0.5), 0.0, std::sqrt(0.5), 0.0);  // z to x, x to -z
const Quat kQuarterTurnX(std::sqrt(0.5), std::sqrt(0.5), 0.0, 0.0);  // y to z, z to -y

void expectNear(const Vec3& got, const Vec3& expected) {
  EXPECT_LT((got - expected).norm(), 1e-12) << got.transpose() << " vs " << expected.transpose();
}

TEST(Transform, ParentTurnsScalesAndMovesTheChild) {
  Scene scene;
  GameObject& parent = scene.create("P");
  parent.transform().setLocalPosition(Vec3(10, 0, 0));
  parent.transform().setLocalRotation(kQuarterTurnY);
  parent.transform().setLocalScale(Vec3(2, 3, 4));
  GameObject& child = scene.create("C", &parent);
  child.transform().setLocalPosition(Vec3(1, 1, 1));
  child.transform().setLocalRotation(kQuarterTurnX);
  child.transform().setLocalScale(0.5);
  // (1, 1, 1) scaled: (2, 3, 4); turned about y: (4, 3, -2).
  expectNear(child.transform().position(), Vec3(14, 3, -2));
  expectNear(child.transform().lossyScale(), Vec3(1, 1.5, 2));
  // The child's z is the parent's -y; its up is the parent's z, the world's x.
  expectNear(child.transform().forward(), Vec3(0, -1, 0));
  expectNear(child.transform().up(), Vec3(1, 0, 0));
  expectNear(child.transform().right(), Vec3(0, 0, -1));
  // Local (0, 0, 2): halved 1, turned (0, -1, 0), + (1, 1, 1) = (1, 0, 1), scaled (2, 0, 4),
  // turned (4, 0, -2).
  expectNear(child.transform().transformPoint(Vec3(0, 0, 2)), Vec3(14, 0, -2));
}

TEST(Transform, WorldSettersInvertTheChain) {
  Scene scene;
  GameObject& parent = scene.create("P");
  parent.transform().setLocalPosition(Vec3(10, 0, 0));
  parent.transform().setLocalRotation(kQuarterTurnY);
  parent.transform().setLocalScale(Vec3(2, 3, 4));
  GameObject& child = scene.create("C", &parent);
  child.transform().setPose({Vec3(14, 3, -2), kQuarterTurnY * kQuarterTurnX});
  expectNear(child.transform().localPosition(), Vec3(1, 1, 1));
  EXPECT_LT(child.transform().localRotation().angularDistance(kQuarterTurnX), 1e-7);
  expectNear(child.transform().pose().position, Vec3(14, 3, -2));
}

// The recorded hammer (scale 0.1 under the controller) puts its marker where the log has it.
TEST(Transform, HammerMarkerInTheControllersFrame) {
  Scene scene;
  GameObject& hammer = scene.create("Hammer", &scene.create("Controller"));
  hammer.transform().setLocalPosition(Vec3(0.0096, -0.0491, -0.0545));
  hammer.transform().setLocalRotation(Quat(0.63740873, 0.30295587, 0.6412905, 0.301122));
  hammer.transform().setLocalScale(0.1);
  const Vec3 marker = hammer.transform().transformPoint(Vec3(-0.482, 1.385, -0.005));
  EXPECT_LT((marker - Vec3(0.0099354, 0.0016278, 0.0830947)).norm(), 2e-6);
}

TEST(Transform, RevisionGrowsWithRealChangesOfTheNodeOrAnAncestor) {
  Scene scene;
  GameObject& parent = scene.create("P");
  GameObject& child = scene.create("C", &parent);
  std::uint64_t last = child.transform().revision();
  const auto grew = [&] {
    const bool result = child.transform().revision() > last;
    last = child.transform().revision();
    return result;
  };
  child.transform().setLocalPosition(Vec3::Zero());
  child.transform().setLocalScale(1.0);
  child.transform().setLocalRotation(Quat::Identity());
  EXPECT_FALSE(grew()) << "same values are no change";
  child.transform().setLocalPosition(Vec3(1, 0, 0));
  EXPECT_TRUE(grew());
  parent.transform().setLocalScale(2.0);
  EXPECT_TRUE(grew());
  parent.transform().setLocalRotation(kQuarterTurnX);
  EXPECT_TRUE(grew());
}

}  // namespace
}  // namespace sim2vr::scene

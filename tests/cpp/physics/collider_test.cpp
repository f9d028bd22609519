// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/physics/collider.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "bodies.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::physics {
namespace {

const double kNan = std::numeric_limits<double>::quiet_NaN();

std::string fieldOf(const std::function<void()>& action) {
  try {
    action();
  } catch (const InvalidArgument& error) {
    return error.field();
  }
  return "none";
}

TEST(Collider, ShapesAreChecked) {
  EXPECT_EQ(fieldOf([] { Collider c(Box{Vec3(1, -1, 1)}); }), "collider.size");
  EXPECT_EQ(fieldOf([] { Collider c(Box{Vec3(1, kNan, 1)}); }), "collider.size");
  EXPECT_EQ(fieldOf([] { Collider c(Sphere{-0.5}); }), "collider.radius");
  EXPECT_EQ(fieldOf([] { Collider c(Capsule{kNan, 1.0, 0}); }), "collider.radius");
  EXPECT_EQ(fieldOf([] { Collider c(Capsule{1.0, -1.0, 0}); }), "collider.height");
  EXPECT_EQ(fieldOf([] { Collider c(Capsule{1.0, 2.0, 3}); }), "collider.axis");
  EXPECT_EQ(fieldOf([] { Collider c(Box{}, Vec3(0, 0, kNan)); }), "collider.center");
}

TEST(Collider, DynamicRigidbodyIsRefused) {
  try {
    const Rigidbody body(/*is_kinematic=*/false);
    FAIL() << "no error";
  } catch (const InvalidArgument& error) {
    EXPECT_STREQ(error.what(),
                 "rigidbody.is_kinematic: got false, expected true (dynamic bodies are not "
                 "simulated yet)");
  }
}

TEST(Collider, AttachedRigidbodyIsTheNearestAbove) {
  scene::Scene scene;
  scene::GameObject& root = scene.create("Root");
  scene::GameObject& middle = scene.create("Middle", &root);
  scene::GameObject& leaf = scene.create("Leaf", &middle);
  auto& collider = leaf.addComponent<Collider>(Box{});
  EXPECT_EQ(collider.attachedRigidbody(), nullptr);
  auto& far = root.addComponent<Rigidbody>();
  EXPECT_EQ(collider.attachedRigidbody(), &far);
  auto& near = middle.addComponent<Rigidbody>();
  EXPECT_EQ(collider.attachedRigidbody(), &near);
}

TEST(Collider, ScalesWithTheWholeChainAndItsCentre) {
  scene::Scene scene;
  scene::GameObject& parent = scene.create("P");
  parent.transform().setLocalPosition(Vec3(1, 0, 0));
  parent.transform().setLocalScale(Vec3(2, 1, 1));
  scene::GameObject& child = scene.create("C", &parent);
  child.transform().setLocalScale(Vec3(0.5, -1, 3));
  // Half extents (0.5, 0.5, 1.5); centre 1 + 2 * 0.5 * 0.25 = 1.25.
  auto& box = child.addComponent<Collider>(Box{}, Vec3(0.25, 0, 0));
  auto& probe = scene.create("Probe").addComponent<Collider>(Box{Vec3::Zero()});
  const auto inside = [&](const Vec3& point) {
    probe.transform().setPosition(point);
    return overlaps(box, probe);
  };
  EXPECT_TRUE(inside(Vec3(1.7499, 0.4999, 1.4999)));
  EXPECT_TRUE(inside(Vec3(0.7501, -0.4999, -1.4999)));
  EXPECT_FALSE(inside(Vec3(1.7501, 0, 0)));
  EXPECT_FALSE(inside(Vec3(0.7499, 0, 0)));
  EXPECT_FALSE(inside(Vec3(1.25, 0.5001, 0)));
  EXPECT_FALSE(inside(Vec3(1.25, 0, 1.5001)));
}

TEST(Collider, SphereTakesTheLargestScaleAndCapsuleItsOwnAxes) {
  scene::Scene scene;
  scene::GameObject& object = scene.create("A");
  object.transform().setLocalScale(Vec3(1, 2, 3));
  auto& sphere = object.addComponent<Collider>(Sphere{0.1});            // radius 0.3
  auto& capsule = object.addComponent<Collider>(Capsule{0.1, 1.0, 1});  // radius 0.3, height 2
  auto& probe = scene.create("Probe").addComponent<Collider>(Box{Vec3::Zero()});
  const auto inside = [&](const Collider& collider, const Vec3& point) {
    probe.transform().setPosition(point);
    return overlaps(collider, probe);
  };
  EXPECT_TRUE(inside(sphere, Vec3(0.2999, 0, 0)));
  EXPECT_FALSE(inside(sphere, Vec3(0.3001, 0, 0)));
  EXPECT_TRUE(inside(capsule, Vec3(0, 0.9999, 0)));
  EXPECT_FALSE(inside(capsule, Vec3(0, 1.0001, 0)));
  EXPECT_TRUE(inside(capsule, Vec3(0.2999, 0.6999, 0)));
  EXPECT_FALSE(inside(capsule, Vec3(0.3001, 0.6999, 0)));
}

TEST(Collider, VelocityComesFromTheLastTwoFrames) {
  scene::Scene scene;
  scene::GameObject& object = scene.create("A");
  auto& collider = object.addComponent<Collider>(Box{}, Vec3(0, 0, 1));
  scene.runFrame(100'000'000, [] {});
  EXPECT_EQ(collider.velocity_mps(), Vec3::Zero()) << "seen once";
  object.transform().setPosition(Vec3(0.3, 0, 0));
  scene.runFrame(200'000'000, [] {});
  EXPECT_LT((collider.velocity_mps() - Vec3(3, 0, 0)).norm(), 1e-6);
  // Turning a half turn about y carries the centre from z = 1 to z = -1.
  object.transform().setRotation(Quat(0, 0, 1, 0));
  scene.runFrame(300'000'000, [] {});
  EXPECT_LT((collider.velocity_mps() - Vec3(0, 0, -20)).norm(), 1e-5);
  collider.setEnabled(false);
  object.transform().setPosition(Vec3(50, 0, 0));
  collider.setEnabled(true);
  scene.runFrame(400'000'000, [] {});
  EXPECT_EQ(collider.velocity_mps(), Vec3::Zero()) << "a pause is no motion";
}

TEST(Collider, FieldsRestoreShapeAndVelocity) {
  scene::Scene scene;
  auto& saved =
      scene.create("A").addComponent<Collider>(Capsule{0.25, 3.0, 2}, Vec3(1, 2, 3), true);
  Archive archive = Archive::saver();
  saved.fields(archive);
  auto& loaded = scene.create("B").addComponent<Collider>(Box{});
  Archive loader = Archive::loader(archive.bytes());
  loaded.fields(loader);
  loader.expectEnd();
  const auto& capsule = std::get<Capsule>(loaded.shape());
  EXPECT_EQ(capsule.radius, 0.25);
  EXPECT_EQ(capsule.height, 3.0);
  EXPECT_EQ(capsule.axis, 2);
  EXPECT_EQ(loaded.center(), Vec3(1, 2, 3));
  EXPECT_TRUE(loaded.isTrigger());
}

}  // namespace
}  // namespace sim2vr::physics

// SPDX-License-Identifier: Apache-2.0
// Which pairs have trigger events at all.
#include <gtest/gtest.h>

#include "bodies.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::physics {
namespace {

// Two overlapping unit boxes; counts the pairs found.
struct Two {
  scene::Scene scene;
  PhysicsWorld world{scene};
  scene::GameObject& a = scene.create("A");
  scene::GameObject& b = scene.create("B");

  int pairs(bool a_trigger, bool b_trigger, bool a_body, bool b_body) {
    if (a_body) a.addComponent<Rigidbody>();
    if (b_body) b.addComponent<Rigidbody>();
    a.addComponent<Collider>(Box{}, Vec3::Zero(), a_trigger);
    b.addComponent<Collider>(Box{}, Vec3::Zero(), b_trigger);
    world.step();
    return world.overlapCount();
  }
};

TEST(TriggerRules, NeedATriggerAndABody) {
  EXPECT_EQ(Two().pairs(true, false, true, false), 1);
  EXPECT_EQ(Two().pairs(true, false, false, true), 1) << "the body may be the other's";
  EXPECT_EQ(Two().pairs(false, true, true, false), 1);
  EXPECT_EQ(Two().pairs(true, true, true, true), 1);
  EXPECT_EQ(Two().pairs(true, true, false, false), 0) << "no body";
  EXPECT_EQ(Two().pairs(false, false, true, true), 0) << "no trigger";
}

TEST(TriggerRules, CollidersOfOneBodyDoNotMeet) {
  scene::Scene scene;
  PhysicsWorld world(scene);
  scene::GameObject& root = scene.create("Root");
  root.addComponent<Rigidbody>();
  root.addComponent<Collider>(Box{}, Vec3::Zero(), true);
  scene.create("Child", &root).addComponent<Collider>(Box{}, Vec3::Zero(), true);
  world.step();
  EXPECT_EQ(world.overlapCount(), 0);
}

TEST(TriggerRules, LayersDecideWhoMeets) {
  Two two;
  two.a.setLayer(10);
  two.b.setLayer(11);
  EXPECT_TRUE(two.world.layersCollide(10, 11));
  two.world.setLayerCollision(11, 10, false);
  EXPECT_FALSE(two.world.layersCollide(10, 11)) << "both orders";
  EXPECT_EQ(two.pairs(true, false, true, false), 0);
  two.b.setLayer(12);
  two.world.step();
  EXPECT_EQ(two.world.overlapCount(), 1) << "a new layer counts at once";
  two.b.setLayer(11);
  two.world.step();
  EXPECT_EQ(two.world.overlapCount(), 0);
  two.world.setLayerCollision(10, 11, true);
  two.world.step();
  EXPECT_EQ(two.world.overlapCount(), 1);
}

TEST(TriggerRules, LayersAreChecked) {
  Two two;
  try {
    two.world.setLayerCollision(3, 32, false);
    FAIL() << "no error";
  } catch (const InvalidArgument& error) {
    EXPECT_STREQ(error.what(), "layer: got 32, expected a layer from 0 to 31");
  }
  EXPECT_THROW(two.world.layersCollide(-1, 0), InvalidArgument);
  two.a.setLayer(99);
  EXPECT_THROW(two.pairs(true, false, true, false), InvalidArgument);
}

}  // namespace
}  // namespace sim2vr::physics

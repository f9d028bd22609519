// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "recorder.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::scene {
namespace {

TEST(Tree, FindFollowsPathsFromTheRoots) {
  Scene scene;
  GameObject& rig = scene.create("XR Rig");
  GameObject& hand = scene.create("Right Controller", &rig);
  GameObject& hammer = scene.create("Hammer", &hand);
  GameObject& other = scene.create("Hammer");
  EXPECT_EQ(scene.find("XR Rig"), &rig);
  EXPECT_EQ(scene.find("XR Rig/Right Controller/Hammer"), &hammer);
  EXPECT_EQ(scene.find("Hammer"), &other) << "a bare name is a root's";
  EXPECT_EQ(scene.find("Right Controller"), nullptr);
  EXPECT_EQ(scene.find("XR Rig/Left Controller/Hammer"), nullptr);
  EXPECT_EQ(scene.find(""), nullptr);
}

TEST(Tree, IdsAreUniqueAndNeverReused) {
  Scene scene;
  GameObject& a = scene.create("A");
  const std::uint64_t id = a.id();
  EXPECT_EQ(scene.findById(id), &a);
  scene.destroy(a);
  scene.runFrame(1, [] {});
  EXPECT_EQ(scene.findById(id), nullptr);
  EXPECT_GT(scene.create("B").id(), id);
}

TEST(Tree, GetComponentFindsTheFirstOfAKind) {
  Calls calls;
  Scene scene;
  GameObject& object = scene.create("A");
  EXPECT_EQ(object.getComponent<Recorder>(), nullptr);
  auto& first = object.addComponent<Recorder>(calls, "1");
  object.addComponent<Recorder>(calls, "2");
  EXPECT_EQ(object.getComponent<Recorder>(), &first);
  EXPECT_EQ(object.getComponent<Component>(), &first);
}

TEST(Tree, PrefabsAreBuiltUnderTheParentWithTheirName) {
  Scene scene;
  scene.registerPrefab("Target", [&scene](GameObject& object) {
    object.setLayer(10);
    scene.create("Ring", &object);
  });
  GameObject& area = scene.create("Area");
  GameObject& target = scene.instantiate("Target", "Target 1", &area);
  EXPECT_EQ(target.prefab(), "Target");
  EXPECT_EQ(target.layer(), 10);
  EXPECT_EQ(scene.find("Area/Target 1"), &target);
  EXPECT_NE(scene.find("Area/Target 1/Ring"), nullptr);
}

TEST(Tree, PrefabNamesAreChecked) {
  Scene scene;
  scene.registerPrefab("Target", [](GameObject&) {});
  try {
    scene.registerPrefab("Target", [](GameObject&) {});
    FAIL() << "no error";
  } catch (const InvalidArgument& error) {
    EXPECT_STREQ(error.what(), "prefab: got 'Target' twice, expected a name not registered before");
  }
  try {
    scene.instantiate("Traget", "x");
    FAIL() << "no error";
  } catch (const InvalidArgument& error) {
    EXPECT_STREQ(error.what(), "prefab: got 'Traget', expected a registered prefab");
  }
}

TEST(Tree, StructureRevisionGrowsWithObjectsAndComponents) {
  Calls calls;
  Scene scene;
  std::uint64_t last = scene.structureRevision();
  const auto grew = [&] {
    const bool result = scene.structureRevision() > last;
    last = scene.structureRevision();
    return result;
  };
  GameObject& object = scene.create("A");
  EXPECT_TRUE(grew());
  object.addComponent<Recorder>(calls, "a");
  EXPECT_TRUE(grew());
  scene.runFrame(1, [] {});
  EXPECT_FALSE(grew()) << "an uneventful frame changes nothing";
  object.setActive(false);
  EXPECT_TRUE(grew());
  scene.destroy(object);
  scene.runFrame(2, [] {});
  EXPECT_TRUE(grew());
}

}  // namespace
}  // namespace sim2vr::scene

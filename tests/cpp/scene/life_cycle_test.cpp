// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "recorder.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::scene {
namespace {

TEST(LifeCycle, CallsOfTheFirstTwoFrames) {
  Calls calls;
  Scene scene(oneStepPerFrame());
  scene.create("A").addComponent<Recorder>(calls, "a");
  EXPECT_EQ(calls, (Calls{"a.Awake", "a.OnEnable"}));
  EXPECT_EQ(runFrame(scene, calls, 1),
            (Calls{"a.Start", "a.FixedUpdate", "physics", "a.Update", "a.LateUpdate"}));
  EXPECT_EQ(runFrame(scene, calls, 2),
            (Calls{"a.FixedUpdate", "physics", "a.Update", "a.LateUpdate"}));
}

TEST(LifeCycle, FrameWithoutAFixedStepAndFrameWithTwo) {
  Calls calls;
  Scene scene(oneStepPerFrame());
  scene.create("A").addComponent<Recorder>(calls, "a");
  calls.clear();
  scene.runFrame(kFrame_ns - 1, [&] { calls.push_back("physics"); });
  EXPECT_EQ(calls, (Calls{"a.Start", "a.Update", "a.LateUpdate"}));
  EXPECT_EQ(runFrame(scene, calls, 2), (Calls{"a.FixedUpdate", "physics", "a.FixedUpdate",
                                              "physics", "a.Update", "a.LateUpdate"}));
}

TEST(LifeCycle, PhasesRunByExecutionOrderThenByCreation) {
  Calls calls;
  Scene scene(oneStepPerFrame());
  GameObject& object = scene.create("A");
  object.addComponent<Recorder>(calls, "reward", 5);
  object.addComponent<Recorder>(calls, "first");
  scene.create("B").addComponent<Recorder>(calls, "pose", -50);
  object.addComponent<Recorder>(calls, "second");
  runFrame(scene, calls, 1);
  EXPECT_EQ(
      runFrame(scene, calls, 2),
      (Calls{"pose.FixedUpdate", "first.FixedUpdate", "second.FixedUpdate", "reward.FixedUpdate",
             "physics", "pose.Update", "first.Update", "second.Update", "reward.Update",
             "pose.LateUpdate", "first.LateUpdate", "second.LateUpdate", "reward.LateUpdate"}));
}

TEST(LifeCycle, ObjectMadeInUpdateStartsBeforeItsFirstLateUpdate) {
  Calls calls;
  Scene scene(oneStepPerFrame());
  auto& maker = scene.create("A").addComponent<Recorder>(calls, "a");
  bool made = false;
  maker.on_update = [&] {
    if (!made) scene.create("B").addComponent<Recorder>(calls, "b");
    made = true;
  };
  EXPECT_EQ(runFrame(scene, calls, 1),
            (Calls{"a.Start", "a.FixedUpdate", "physics", "a.Update", "b.Awake", "b.OnEnable",
                   "b.Start", "a.LateUpdate", "b.LateUpdate"}));
  EXPECT_EQ(runFrame(scene, calls, 2),
            (Calls{"a.FixedUpdate", "b.FixedUpdate", "physics", "a.Update", "b.Update",
                   "a.LateUpdate", "b.LateUpdate"}));
}

TEST(LifeCycle, ObjectMadeInThePhysicsStepStartsBeforeTheNextStep) {
  Calls calls;
  Scene scene(oneStepPerFrame());
  bool made = false;
  scene.runFrame(2 * kFrame_ns, [&] {
    calls.push_back("physics");
    if (!made) scene.create("B").addComponent<Recorder>(calls, "b");
    made = true;
  });
  EXPECT_EQ(calls, (Calls{"physics", "b.Awake", "b.OnEnable", "b.Start", "b.FixedUpdate", "physics",
                          "b.Update", "b.LateUpdate"}));
}

TEST(LifeCycle, DestroyedObjectIsOffAtOnceAndGoneAtTheEndOfTheFrame) {
  Calls calls;
  Scene scene(oneStepPerFrame());
  auto& killer = scene.create("A").addComponent<Recorder>(calls, "a");
  GameObject& victim = scene.create("B");
  victim.addComponent<Recorder>(calls, "b");
  GameObject& child = scene.create("C", &victim);
  child.addComponent<Recorder>(calls, "c");
  const std::uint64_t child_id = child.id();
  killer.on_update = [&] {
    scene.destroy(victim);
    scene.destroy(victim);  // twice is once
    EXPECT_TRUE(victim.destroyed());
    EXPECT_FALSE(child.activeInHierarchy());
    EXPECT_EQ(scene.find("B"), nullptr);
  };
  EXPECT_EQ(runFrame(scene, calls, 1),
            (Calls{"a.Start", "b.Start", "c.Start", "a.FixedUpdate", "b.FixedUpdate",
                   "c.FixedUpdate", "physics", "a.Update", "b.OnDisable", "c.OnDisable",
                   "a.LateUpdate", "b.OnDestroy", "c.OnDestroy"}));
  EXPECT_EQ(scene.findById(child_id), nullptr);
  EXPECT_EQ(scene.objects().size(), 1U);
}

TEST(LifeCycle, OnDestroyMayMakeAndDestroyObjects) {
  Calls calls;
  Scene scene(oneStepPerFrame());
  GameObject& other = scene.create("Other");
  other.addComponent<Recorder>(calls, "other");
  GameObject& object = scene.create("A");
  object.addComponent<Recorder>(calls, "a").on_destroy = [&] {
    for (int i = 0; i < 100; ++i) scene.create("Shard");
    scene.destroy(other);
  };
  calls.clear();
  scene.destroy(object);
  runFrame(scene, calls, 1);
  runFrame(scene, calls, 2);
  EXPECT_EQ(scene.objects().size(), 100U);
  EXPECT_EQ(scene.find("Other"), nullptr);
}

TEST(LifeCycle, DestroyedObjectInOnDestroyHearsOfIt) {
  Calls calls;
  Scene scene(oneStepPerFrame());
  GameObject& other = scene.create("Other");
  other.addComponent<Recorder>(calls, "other");
  GameObject& object = scene.create("A");
  object.addComponent<Recorder>(calls, "a").on_destroy = [&] { scene.destroy(other); };
  scene.destroy(object);
  runFrame(scene, calls, 1);
  EXPECT_NE(std::find(calls.begin(), calls.end(), "other.OnDestroy"), calls.end());
}

TEST(LifeCycle, InactiveObjectSleepsAndStartsWhenWoken) {
  Calls calls;
  Scene scene(oneStepPerFrame());
  GameObject& parent = scene.create("P");
  parent.setActive(false);
  GameObject& child = scene.create("C", &parent);
  child.addComponent<Recorder>(calls, "c");
  EXPECT_EQ(calls, (Calls{"c.Awake"}));
  EXPECT_FALSE(child.activeInHierarchy());
  EXPECT_EQ(runFrame(scene, calls, 1), (Calls{"physics"}));
  calls.clear();
  parent.setActive(true);
  EXPECT_EQ(calls, (Calls{"c.OnEnable"}));
  EXPECT_EQ(runFrame(scene, calls, 2),
            (Calls{"c.Start", "c.FixedUpdate", "physics", "c.Update", "c.LateUpdate"}));
  calls.clear();
  parent.setActive(false);
  parent.setActive(false);
  EXPECT_EQ(calls, (Calls{"c.OnDisable"}));
}

TEST(LifeCycle, DisabledComponentRestsAloneOnItsObject) {
  Calls calls;
  Scene scene(oneStepPerFrame());
  GameObject& object = scene.create("A");
  auto& a = object.addComponent<Recorder>(calls, "a");
  object.addComponent<Recorder>(calls, "b");
  runFrame(scene, calls, 1);
  calls.clear();
  const std::uint64_t before = scene.structureRevision();
  a.setEnabled(false);
  EXPECT_GT(scene.structureRevision(), before);
  EXPECT_EQ(calls, (Calls{"a.OnDisable"}));
  EXPECT_EQ(runFrame(scene, calls, 2),
            (Calls{"b.FixedUpdate", "physics", "b.Update", "b.LateUpdate"}));
  calls.clear();
  a.setEnabled(true);
  EXPECT_EQ(calls, (Calls{"a.OnEnable"}));
}

// Adds sixteen more components from within OnEnable.
class Grower : public Component {
 public:
  explicit Grower(Calls& calls) : calls_(calls) {}
  std::string_view typeName() const override { return "Grower"; }
  void OnEnable() override {
    for (int i = 0; i < 16; ++i) gameObject().addComponent<Recorder>(calls_, "r");
  }

 private:
  Calls& calls_;
};

TEST(LifeCycle, OnEnableMayAddComponents) {
  Calls calls;
  Scene scene;
  GameObject& object = scene.create("A");
  object.addComponent<Grower>(calls);
  EXPECT_EQ(object.components().size(), 17U);
  Calls expected;
  for (int i = 0; i < 16; ++i) expected.insert(expected.end(), {"r.Awake", "r.OnEnable"});
  EXPECT_EQ(calls, expected);
}

TEST(LifeCycle, ForEachVisitsComponentsThatAreOnInOrder) {
  Calls calls;
  Scene scene;
  scene.create("A").addComponent<Recorder>(calls, "a", 3).value = 1;
  scene.create("B").addComponent<Recorder>(calls, "b", 1).value = 2;
  scene.create("C").addComponent<Recorder>(calls, "c", 2).setEnabled(false);
  std::vector<int> seen;
  scene.forEach<Recorder>([&](Recorder& r) { seen.push_back(r.value); });
  EXPECT_EQ(seen, (std::vector<int>{2, 1}));
}

}  // namespace
}  // namespace sim2vr::scene

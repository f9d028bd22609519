// SPDX-License-Identifier: Apache-2.0
// Sequence of trigger events.
#include <gtest/gtest.h>

#include "bodies.hpp"

namespace sim2vr::physics {
namespace {

TEST(Triggers, EnterStayExit) {
  Arena arena;
  Collider& hammer = arena.addHammer("h", 0.0);
  arena.addTarget("t", 2.0);
  EXPECT_EQ(arena.step(), (Events{}));
  Arena::moveTo(hammer, 1.0);  // touching
  EXPECT_EQ(arena.step(), (Events{"h.Enter(t)", "t.Enter(h)"}));
  EXPECT_EQ(arena.step(), (Events{"h.Stay(t)", "t.Stay(h)"})) << "nothing moved";
  Arena::moveTo(hammer, 1.5);
  EXPECT_EQ(arena.step(), (Events{"h.Stay(t)", "t.Stay(h)"}));
  Arena::moveTo(hammer, 0.999);
  EXPECT_EQ(arena.step(), (Events{"h.Exit(t)", "t.Exit(h)"}));
  EXPECT_EQ(arena.step(), (Events{}));
  Arena::moveTo(hammer, 1.5);
  EXPECT_EQ(arena.step(), (Events{"h.Enter(t)", "t.Enter(h)"}));
}

TEST(Triggers, OrderIsExitsEntersStaysByCreation) {
  Arena arena;
  Collider& hammer = arena.addHammer("h", 0.0);
  arena.addTarget("stays", 0.75);
  arena.addTarget("enters2", 1.5);
  arena.addTarget("leaves", -0.75);
  arena.addTarget("enters1", 1.4);
  arena.world.setLayerCollision(1, 1, false);
  for (const auto& object : arena.scene.objects()) object->setLayer(1);
  hammer.gameObject().setLayer(2);
  arena.step();
  Arena::moveTo(hammer, 0.7);
  EXPECT_EQ(arena.step(),
            (Events{"h.Exit(leaves)", "leaves.Exit(h)", "h.Enter(enters2)", "enters2.Enter(h)",
                    "h.Enter(enters1)", "enters1.Enter(h)", "h.Stay(stays)", "stays.Stay(h)"}));
}

TEST(Triggers, ScaleCounts) {
  Arena arena;
  arena.addHammer("h", 0.0);
  Collider& target = arena.addTarget("t", 2.0);
  arena.step();
  target.transform().setLocalScale(3.1);
  EXPECT_EQ(arena.step(), (Events{"h.Enter(t)", "t.Enter(h)"}));
  target.transform().setLocalScale(1.0);
  EXPECT_EQ(arena.step(), (Events{"h.Exit(t)", "t.Exit(h)"}));
}

TEST(Triggers, MotionOfAParentCounts) {
  Arena arena;
  scene::GameObject& controller = arena.scene.create("Controller");
  controller.transform().setPosition(Vec3(-5, 0, 0));
  scene::GameObject& head = arena.scene.create("h", &controller);
  head.addComponent<Collider>(Box{});
  arena.addTarget("t", 0.0);
  EXPECT_EQ(arena.step(), (Events{}));
  controller.transform().setPosition(Vec3(0.5, 0, 0));
  EXPECT_EQ(arena.step(), (Events{"t.Enter(h)"}));
}

TEST(Triggers, TheBodysObjectHearsOfItsChildrensContacts) {
  Arena arena;
  scene::GameObject& body = arena.scene.create("Body");
  body.addComponent<Rigidbody>();
  body.addComponent<Listener>(arena.events, "body");
  scene::GameObject& part = arena.scene.create("Part", &body);
  part.addComponent<Collider>(Box{}, Vec3::Zero(), true);
  part.addComponent<Listener>(arena.events, "part");
  arena.addHammer("h", 0.0);
  EXPECT_EQ(arena.step(), (Events{"part.Enter(h)", "body.Enter(h)", "h.Enter(Part)"}));
}

TEST(Triggers, DisabledListenersHearToo) {
  Arena arena;
  arena.addHammer("h", 0.0).gameObject().getComponent<Listener>()->setEnabled(false);
  arena.addTarget("t", 0.5);
  EXPECT_EQ(arena.step(), (Events{"h.Enter(t)", "t.Enter(h)"}));
}

TEST(Triggers, SwitchedOffLeavesSilentlyAndEntersAnew) {
  Arena arena;
  arena.addHammer("h", 0.0);
  Collider& target = arena.addTarget("t", 0.5);
  arena.step();
  target.setEnabled(false);
  EXPECT_EQ(arena.step(), (Events{}));
  EXPECT_EQ(arena.world.overlapCount(), 0);
  target.setEnabled(true);
  EXPECT_EQ(arena.step(), (Events{"h.Enter(t)", "t.Enter(h)"}));
  // Off and on again between two steps.
  target.gameObject().setActive(false);
  target.gameObject().setActive(true);
  EXPECT_EQ(arena.step(), (Events{"h.Enter(t)", "t.Enter(h)"}));
  arena.scene.destroy(target.gameObject());
  EXPECT_EQ(arena.step(), (Events{}));
}

TEST(Triggers, OverlapsSurviveChangesElsewhereInTheScene) {
  Arena arena;
  arena.addHammer("h", 0.0);
  arena.addTarget("t", 0.5);
  arena.step();
  arena.addTarget("new", 50.0);
  EXPECT_EQ(arena.step(), (Events{"h.Stay(t)", "t.Stay(h)"}));
}

TEST(Triggers, CallbackMayDestroyTheOther) {
  Arena arena;
  Collider& hammer = arena.addHammer("h", 0.0);
  Collider& target = arena.addTarget("t", 0.5);
  hammer.gameObject().getComponent<Listener>()->on_event = [&](const scene::TriggerContact&) {
    arena.scene.destroy(target.gameObject());
  };
  EXPECT_EQ(arena.step(), (Events{"h.Enter(t)"})) << "the destroyed side hears nothing";
  arena.scene.runFrame(50'000'000, [&] { arena.world.step(); });
  EXPECT_EQ(arena.step(), (Events{}));
}

TEST(Triggers, CallbackMayDestroyItselfAndStopTheOtherPairs) {
  Arena arena;
  Collider& hammer = arena.addHammer("h", 0.0);
  arena.addTarget("t1", 0.5);
  arena.addTarget("t2", -0.9);
  hammer.gameObject().getComponent<Listener>()->on_event = [&](const scene::TriggerContact&) {
    arena.scene.destroy(hammer.gameObject());
  };
  EXPECT_EQ(arena.step(), (Events{"h.Enter(t1)"}));
}

TEST(Triggers, CallbackMayMoveDisableAndMakeThings) {
  Arena arena;
  Collider& hammer = arena.addHammer("h", 0.0);
  Collider& target = arena.addTarget("t", 0.5);
  bool done = false;
  target.gameObject().getComponent<Listener>()->on_event = [&](const scene::TriggerContact&) {
    if (done) return;
    done = true;
    Arena::moveTo(hammer, 10.0);
    for (int i = 0; i < 50; ++i) arena.addTarget("new", 10.0 + 2.0 * i);
    for (int i = 0; i < 50; ++i) target.gameObject().addComponent<Listener>(arena.events, "late");
  };
  EXPECT_EQ(arena.step().size(), 2U + 50U) << "components added by a callback hear the event too";
  const Events events = arena.step();
  ASSERT_GE(events.size(), 2U);
  EXPECT_EQ(events[0], "h.Exit(t)");
  EXPECT_EQ(events[1], "t.Exit(h)");
  EXPECT_EQ(events[events.size() - 2], "h.Enter(new)");
  EXPECT_EQ(events.back(), "new.Enter(h)");
}

TEST(Triggers, ContactCarriesTheRelativeVelocity) {
  Arena arena;
  Collider& hammer = arena.addHammer("h", -3.0);
  Collider& target = arena.addTarget("t", 0.0);
  Vec3 heard_by_target = Vec3::Zero();
  Vec3 heard_by_hammer = Vec3::Zero();
  target.gameObject().getComponent<Listener>()->on_event =
      [&](const scene::TriggerContact& contact) {
        heard_by_target = contact.relative_velocity_mps;
      };
  hammer.gameObject().getComponent<Listener>()->on_event =
      [&](const scene::TriggerContact& contact) {
        heard_by_hammer = contact.relative_velocity_mps;
      };
  const auto frame = [&](std::int64_t n) {
    arena.scene.runFrame(n * 100'000'000, [&] { arena.world.step(); });
  };
  frame(1);
  Arena::moveTo(hammer, -2.5);
  Arena::moveTo(target, 0.1);
  frame(2);  // the hammer does 5 m/s, the target 1 m/s
  Arena::moveTo(hammer, -0.5);
  frame(3);  // enters: velocities as of frame 2
  EXPECT_EQ(arena.events.front(), "h.Enter(t)");
  EXPECT_LT((heard_by_target - Vec3(4, 0, 0)).norm(), 1e-6) << heard_by_target.transpose();
  EXPECT_LT((heard_by_hammer - Vec3(-4, 0, 0)).norm(), 1e-6);
}

TEST(Triggers, OverlapsComeBackFromASave) {
  Arena arena;
  arena.addHammer("h", 0.0);
  arena.addTarget("t", 0.5);
  arena.world.setLayerCollision(4, 5, false);
  arena.step();
  Archive saved = Archive::saver();
  arena.scene.fields(saved);
  arena.world.fields(saved);

  Arena fresh;
  fresh.addHammer("h", 7.0);
  fresh.addTarget("t", 0.0);
  Archive loader = Archive::loader(saved.bytes());
  fresh.scene.fields(loader);
  fresh.world.fields(loader);
  loader.expectEnd();
  EXPECT_FALSE(fresh.world.layersCollide(4, 5));
  EXPECT_EQ(fresh.step(), (Events{"h.Stay(t)", "t.Stay(h)"})) << "no second Enter";

  Archive again = Archive::saver();
  fresh.scene.fields(again);
  fresh.world.fields(again);
  EXPECT_EQ(again.bytes(), saved.bytes());
}

}  // namespace
}  // namespace sim2vr::physics

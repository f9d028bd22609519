// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "whacamole_player.hpp"

namespace sim2vr::games::whacamole {
namespace {

TEST(Hammer, MarkerSitsWhereTheRecordingsHaveIt) {
  WhacAMoleRound round("{}");
  round.harness.frame(0, {{Vec3(0, 1.2, 0), Quat::Identity()}, {Vec3(1, 2, 3), Quat::Identity()}});
  const Vec3 marker = round.round().hammer().markerPosition() - Vec3(1, 2, 3);
  EXPECT_LT((marker - Vec3(0.0099354, 0.0016278, 0.0830947)).norm(), 2e-6);
}

TEST(Hammer, HeadIsABoxOfTenByFiveAndAHalfCentimetres) {
  WhacAMoleRound round("{}");
  round.harness.frame(0, {{Vec3(0, 1.2, 0), Quat::Identity()}, {Vec3::Zero(), Quat::Identity()}});
  const auto& object = *round.harness.scene().find("XR Rig/RightHand Controller/Hammer");
  const auto* collider = object.getComponent<physics::Collider>();
  ASSERT_NE(collider, nullptr);
  EXPECT_FALSE(collider->isTrigger());
  EXPECT_EQ(object.layer(), 11);
  const auto& box = std::get<physics::Box>(collider->shape());
  EXPECT_TRUE((box.size * 0.1).isApprox(Vec3(0.10, 0.055, 0.055), 1e-12));
  EXPECT_LT((object.transform().transformPoint(collider->center()) -
             Vec3(0.0094392, 0.0393488, 0.0537127))
                .norm(),
            1e-6);
  // Strike = -x of the hammer.
  EXPECT_LT((object.transform().right() - Vec3(-0.003856, 0.772441, -0.635075)).norm(), 1e-5);
  EXPECT_LT((object.transform().up() - Vec3(0.004690, 0.635087, 0.772427)).norm(), 1e-5);
}

// By hand: v1 = 0; raw2 = 0.1 m / 0.05 s = 2, v2 = 0.5 * 2 = 1; raw3 = 2, v3 = 1 + 0.5 (2 - 1)
// = 1.5; raw4 = 0, v4 = 0.75.
TEST(Hammer, VelocityIsTheHalfSmoothedRootVelocity) {
  WhacAMoleRound round("{}", 1, testing::referenceTime(), nullptr, 50'000'000);
  const Hammer& hammer = round.round().hammer();
  round.frameWithRoot(Vec3(0.0, 1.0, 0.0));
  EXPECT_EQ(hammer.velocity_mps(), Vec3(Vec3::Zero()));
  round.frameWithRoot(Vec3(0.0, 1.0, 0.1));
  EXPECT_NEAR(hammer.velocity_mps().z(), 1.0, 1e-5);
  round.frameWithRoot(Vec3(0.0, 1.0, 0.2));
  EXPECT_NEAR(hammer.velocity_mps().z(), 1.5, 1e-5);
  round.frameWithRoot(Vec3(0.0, 1.0, 0.2));
  EXPECT_NEAR(hammer.velocity_mps().z(), 0.75, 1e-5);
  EXPECT_NEAR(hammer.velocity_mps().x(), 0.0, 1e-5);
}

// Turning the hand about the root moves the head but not the root.
TEST(Hammer, VelocityIgnoresTheHead) {
  WhacAMoleRound round("{}");
  const Pose root{Vec3(0.0, 1.0, 0.0), Quat::Identity()};
  const Pose turned{root.position, Quat(0.0, 1.0, 0.0, 0.0)};
  const Pose head{Vec3(0, 1.2, 0), Quat::Identity()};
  round.harness.frame(0, {head, root * kControllerToHammer.inverse()});
  round.harness.frame(50'000'000, {head, turned * kControllerToHammer.inverse()});
  EXPECT_LT(round.round().hammer().velocity_mps().norm(), 1e-5);
}

// The head's centre lies 0.139758 m along the hammer's y axis: half a turn about x moves it by
// -0.279517 m in y and 0.0016356 m in z, in 50 ms.
TEST(Hammer, SettingsChooseTheHeadAndTheSmoothing) {
  WhacAMoleRound round(R"({"velocity_point": "head", "velocity_smoothing": 1.0})", 1,
                       testing::referenceTime(), nullptr, 50'000'000);
  const Pose root{Vec3(0.0, 1.0, 0.0), Quat::Identity()};
  const Pose turned{root.position, Quat(0.0, 1.0, 0.0, 0.0)};
  const Pose head{Vec3(0, 1.2, 0), Quat::Identity()};
  round.harness.frame(0, {head, root * kControllerToHammer.inverse()});
  round.harness.frame(50'000'000, {head, turned * kControllerToHammer.inverse()});
  const Vec3 expected = Vec3(0.0, -2.0 * 0.13975825, 2.0 * 0.0008178129) / 0.05;
  EXPECT_LT((round.round().hammer().velocity_mps() - expected).norm(), 1e-5);
}

TEST(Hammer, MarginGrowsTheHitBoxOnEverySide) {
  WhacAMoleRound round(R"({"hammer_margin_m": 0.001})");
  round.idle();
  const auto& object = *round.harness.scene().find("XR Rig/RightHand Controller/Hammer");
  const auto& box = std::get<physics::Box>(object.getComponent<physics::Collider>()->shape());
  EXPECT_TRUE((box.size * 0.1).isApprox(Vec3(0.102, 0.057, 0.057), 1e-12));
}

// Column 0 of the cells is column 2 in the mirror.
TEST(Hammer, LeftHandPlaysTheMirrorImageOfARound) {
  for (const std::string condition : {"easy", "low-easy", "high-easy"}) {
    const std::string start = R"({"condition": ")" + condition +
                              R"(", "spawn_times": [0.1, 1.6, 3.1, 4.6, 6.1], "spawn_cells": )";
    WhacAMoleRound right(start + "[0, 4, 5, 6, 7]}");
    WhacAMoleRound left(start + R"([2, 4, 3, 8, 7], "hand": "left"})");
    right.head.x() = left.head.x() = 0.02;
    ScriptedPlayer player;
    for (int i = 0; i < 160; ++i) {
      player.frame(right);
      left.frameMirrored(right);
      Vec3 mirrored = right.round().hammer().markerPosition();
      mirrored.x() = -mirrored.x();
      ASSERT_LT((left.round().hammer().markerPosition() - mirrored).norm(), 1e-6);
    }
    EXPECT_EQ(right.harness.log("Points"), 5.0) << condition;
    EXPECT_EQ(left.harness.log("Points"), 5.0) << condition;
    EXPECT_NEAR(left.harness.log("HitSpeed"), right.harness.log("HitSpeed"), 1e-5);
    EXPECT_NEAR(left.harness.log("HammerDepthNormal"), right.harness.log("HammerDepthNormal"),
                1e-6);
  }
}

TEST(Hammer, OfTheLeftHandFacesAndReachesAsInAMirror) {
  WhacAMoleRound right("{}");
  WhacAMoleRound left(R"({"hand": "left"})");
  right.idle();
  left.frameMirrored(right);
  const auto mirrored = [](Vec3 v) { return Vec3(-v.x(), v.y(), v.z()); };
  const auto& one = *right.harness.scene().find("XR Rig/RightHand Controller/Hammer");
  const auto& other = *left.harness.scene().find("XR Rig/LeftHand Controller/Hammer");
  EXPECT_TRUE(other.transform().right().isApprox(mirrored(one.transform().right()), 1e-6));
  EXPECT_TRUE(other.transform().up().isApprox(mirrored(one.transform().up()), 1e-6));
  const auto center = [](const scene::GameObject& hammer) {
    return hammer.transform().transformPoint(hammer.getComponent<physics::Collider>()->center());
  };
  EXPECT_LT((center(other) - mirrored(center(one))).norm(), 1e-6);
  EXPECT_EQ(left.harness.scene().find("XR Rig/RightHand Controller/Hammer"), nullptr);
}

TEST(Hammer, TwoFramesAtTheSameTimeKeepTheVelocity) {
  WhacAMoleRound round("{}", 1, testing::referenceTime(), nullptr, 0);
  round.frameWithRoot(Vec3(0.0, 1.0, 0.0));
  round.frameWithRoot(Vec3(0.0, 1.0, 0.1));
  EXPECT_EQ(round.round().hammer().velocity_mps(), Vec3(Vec3::Zero()));
}

}  // namespace
}  // namespace sim2vr::games::whacamole

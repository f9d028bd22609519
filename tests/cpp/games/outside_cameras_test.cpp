// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <numbers>

#include "game_harness.hpp"
#include "sim2vr/games/registry.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/rl/room_looks.hpp"
#include "sim2vr/rl/xr_rig.hpp"

namespace sim2vr::games {
namespace {

const Pose kHand{Vec3(0.3, 0.9, 0.3), Quat::Identity()};

Pose headTurned(double yaw_deg, double pitch_deg = 0.0) {
  const double radians = std::numbers::pi / 180.0;
  return {Vec3(1.0, 1.5, 2.0), Quat(Eigen::AngleAxisd(yaw_deg * radians, Vec3::UnitY()) *
                                    Eigen::AngleAxisd(pitch_deg * radians, Vec3::UnitX()))};
}

// Where a point is for the camera: right, up, ahead.
Vec3 seenFrom(const scene::GameObject& camera, const Vec3& point) {
  return camera.transform().rotation().conjugate() * (point - camera.transform().position());
}

TEST(OutsideCameras, StandBehindTheHeadWhereverItFaces) {
  for (const double yaw_deg : {0.0, 90.0, 200.0}) {
    const auto game = createGame("sample");
    testing::GameHarness round(*game, 1);
    rl::addOutsideCameras(round.scene());
    const Pose head = headTurned(yaw_deg, 35.0);
    round.frame(0, {head, kHand});
    const Pose level = headTurned(yaw_deg);
    for (const auto path : {rl::kSpectatorCameraPath, rl::kThirdPersonCameraPath}) {
      scene::GameObject* camera = round.scene().find(path);
      ASSERT_NE(camera, nullptr);
      const Vec3 from_head =
          level.rotation.conjugate() * (camera->transform().position() - head.position);
      EXPECT_GT(from_head.x(), 0.2) << "to the right";
      EXPECT_GT(from_head.y(), 0.2) << "above";
      EXPECT_LT(from_head.z(), -0.4) << "behind";
      // Head and the space within reach lie in the picture: 50 degrees high, 4 : 3.
      const double half_height = std::tan(25.0 * std::numbers::pi / 180.0);
      for (const Vec3& offset : {Vec3(0.0, 0.1, 0.0), Vec3(0.15, -0.35, 0.4)}) {
        const Vec3 seen = seenFrom(*camera, head.position + level.rotation * offset);
        EXPECT_GT(seen.z(), 0.5);
        EXPECT_LT(std::abs(seen.y()) / seen.z(), half_height) << path << " " << offset.y();
        EXPECT_LT(std::abs(seen.x()) / seen.z(), half_height * 4.0 / 3.0) << path;
      }
    }
  }
}

TEST(OutsideCameras, StayWhereTheyWerePutAndAreSavedThere) {
  const auto game = createGame("sample");
  testing::GameHarness round(*game, 1);
  rl::addOutsideCameras(round.scene());
  round.frame(0, {headTurned(0.0), kHand});
  // By hand: 0.95 to the right, 0.35 up and 0.60 behind the head.
  const Vec3 expected(1.95, 1.85, 1.4);
  const auto place = [](testing::GameHarness& of) {
    return of.scene().find(rl::kSpectatorCameraPath)->transform().position();
  };
  EXPECT_LT((place(round) - expected).norm(), 1e-12);
  const std::string saved = round.save();
  round.frame(50'000'000, {headTurned(90.0), kHand});
  EXPECT_LT((place(round) - expected).norm(), 1e-12);
  testing::GameHarness other(*game, 1);
  rl::addOutsideCameras(other.scene());
  other.load(saved);
  other.frame(50'000'000, {headTurned(90.0), kHand});
  EXPECT_LT((place(other) - expected).norm(), 1e-12);
}

TEST(OutsideCameras, ShowHandsThatTheHeadCameraDoesNotSee) {
  const auto game = createGame("sample");
  testing::GameHarness round(*game, 1);
  rl::addOutsideCameras(round.scene());
  const auto* hand = round.scene().find("XR Rig/RightHand Controller/Grip");
  ASSERT_NE(hand, nullptr);
  EXPECT_EQ(hand->layer(), rl::kPlayerLooksLayer);
  const auto* head = round.scene().find(rl::kHeadCameraPath)->getComponent<render::Camera>();
  EXPECT_EQ(head->culling_mask & (1U << rl::kPlayerLooksLayer), 0U);
}

TEST(OutsideCameras, LeaveAGameWithItsOwnAlone) {
  const auto game = createGame("whacamole");
  testing::GameHarness round(*game, 1);
  const std::size_t objects = round.scene().objects().size();
  rl::addOutsideCameras(round.scene());
  EXPECT_EQ(round.scene().objects().size(), objects);
}

}  // namespace
}  // namespace sim2vr::games

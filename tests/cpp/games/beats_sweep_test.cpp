// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "beats/swing.hpp"

namespace sim2vr::games::beats {
namespace {

const Block kCube{Vec3::Zero(), Vec3::Constant(0.175), 0.0};
const Rod kBlade{0.08, 1.08};

Pose at(const Vec3& position) { return {position, Quat::Identity()}; }
Pose turned(double degrees, const Vec3& axis) {
  return {Vec3::Zero(), Quat(Eigen::AngleAxisd(degrees * std::numbers::pi / 180.0, axis))};
}

TEST(BeatsDistance, OfASegmentToACube) {
  // Beside a face, through the middle, off an edge (3-4-5) and off a corner.
  EXPECT_NEAR(distance_m({{0.275, 0.0, -1.0}, {0.275, 0.0, 1.0}}, kCube), 0.1, 1e-12);
  EXPECT_EQ(distance_m({{-1.0, -1.0, -1.0}, {1.0, 1.0, 1.0}}, kCube), 0.0);
  EXPECT_NEAR(distance_m({{0.205, 0.215, -1.0}, {0.205, 0.215, 1.0}}, kCube), 0.05, 1e-12);
  EXPECT_NEAR(distance_m({{0.185, 0.195, 0.195}, {1.0, 1.0, 1.0}}, kCube), 0.03, 1e-12);
  // The end of a segment that points at a face.
  EXPECT_NEAR(distance_m({{0.0, 0.0, -2.0}, {0.0, 0.0, -1.175}}, kCube), 1.0, 1e-12);
  // Nearest in its middle: the line x + y = 0.45 is 0.1 / sqrt(2) from the edge x = y = 0.175.
  EXPECT_NEAR(distance_m({{-1.0, 1.45, 0.0}, {1.45, -1.0, 0.0}}, kCube), 0.1 / std::sqrt(2.0),
              1e-12);
}

TEST(BeatsDistance, OfATurnedCubeAndOfAPoint) {
  // On its corner the cube reaches 0.175 sqrt(2) = 0.24749 sideways.
  const Block turned{Vec3::Zero(), Vec3::Constant(0.175), std::numbers::pi / 4.0};
  EXPECT_NEAR(distance_m({{0.5, 0.0, -1.0}, {0.5, 0.0, 1.0}}, turned), 0.5 - 0.175 * std::sqrt(2.0),
              1e-12);
  const Vec3 point(0.0, 0.375, 0.0);
  EXPECT_NEAR(distance_m({point, point}, kCube), 0.2, 1e-12);
}

// The blade lies along z and goes from x = -1 to 1: it touches where x = -0.175 - 0.015.
TEST(BeatsSweep, FindsWhenABladeComesToACube) {
  const Motion motion(at({-1.0, 0.0, -0.5}), at({1.0, 0.0, -0.5}));
  const auto s = firstContact(motion, kBlade, kCube, Vec3::Zero(), kBladeRadius_m);
  ASSERT_TRUE(s);
  EXPECT_NEAR(*s, (1.0 - 0.19) / 2.0, kSweepTolerance_m);
  // From inside at once; not before it is asked about, and not after.
  EXPECT_EQ(firstContact(motion, kBlade, kCube, Vec3::Zero(), kBladeRadius_m, 0.45, 1.0), 0.45);
  EXPECT_FALSE(firstContact(motion, kBlade, kCube, Vec3::Zero(), kBladeRadius_m, 0.0, 0.4));
  EXPECT_FALSE(firstContact(motion, kBlade, kCube, Vec3::Zero(), kBladeRadius_m, 0.6, 1.0));
}

// Blade and box cross at 40 m/s in one frame of half a second: neither end shows a contact.
TEST(BeatsSweep, NothingJumpsThrough) {
  const Motion motion(at({0.0, 5.0, 0.0}), at({0.0, -5.0, 0.0}));
  Block box = kCube;
  box.center_m = {0.0, 0.0, 10.5};
  const Vec3 drift(0.0, 0.0, -20.0);
  const auto s = firstContact(motion, kBlade, box, drift, kBladeRadius_m);
  ASSERT_TRUE(s);
  // y = 5 - 10 s reaches 0.19; the box covers z = 0.58 from s = 0.487 to 0.505.
  EXPECT_NEAR(*s, (10.5 - 0.175 - 1.08 - 0.015) / 20.0, 0.02);
  // A moment later the box has passed.
  box.center_m.z() = 9.0;
  EXPECT_FALSE(firstContact(motion, kBlade, box, drift, kBladeRadius_m));
}

TEST(BeatsSweep, AbsurdMotionsComeToAnEnd) {
  for (const double far_m : {1e9, 1e15, 1e200}) {
    const Motion motion(at({-far_m, 0.0, -0.5}), at({far_m, 0.0, -0.5}));
    firstContact(motion, kBlade, kCube, Vec3::Zero(), kBladeRadius_m);
  }
  const double none = std::nan("");
  const Motion motion(at({none, 0.0, 0.0}), at({1.0, 0.0, 0.0}));
  firstContact(motion, kBlade, kCube, Vec3::Zero(), kBladeRadius_m);
}

// A swing from straight up over the front to straight down: half a turn in one frame. The cube in
// front, from z = 0.5 on, is met where the blade comes down on its upper edge nearest to the hand.
TEST(BeatsSweep, FollowsASwingAroundTheHand) {
  const Motion swing(turned(-89.0, Vec3::UnitX()), turned(89.0, Vec3::UnitX()));
  EXPECT_TRUE(swing.at(0.5).rotation.isApprox(Quat::Identity(), 1e-12));
  Block box = kCube;
  box.center_m = {0.0, 0.0, 0.675};
  const auto s = firstContact(swing, kBlade, box, Vec3::Zero(), 0.0);
  ASSERT_TRUE(s);
  // The tip's circle of 1.08 m passes above the far upper edge (0.85, 0.175), so that the blade
  // comes down on the near one: at atan(0.175 / 0.5) above the middle.
  const double angle = std::atan2(0.175, 0.5) * 180.0 / std::numbers::pi;
  EXPECT_NEAR(*s, (89.0 - angle) / 178.0, 1e-3);
  // A point of the blade 0.8 m from the hand moves 178 degrees along its circle per frame,
  // downwards in front.
  const Vec3 velocity = swing.velocity({0.0, 0.0, 0.8}, 0.5);
  EXPECT_TRUE(velocity.isApprox(Vec3(0.0, -0.8 * 178.0 * std::numbers::pi / 180.0, 0.0), 1e-9));
}

// Against dense sampling, for motions of all kinds.
TEST(BeatsSweep, AgreesWithDenseSampling) {
  std::mt19937 generator(3);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  const auto vector = [&] { return Vec3(unit(generator), unit(generator), unit(generator)); };
  const auto pose = [&] {
    return Pose{
        0.8 * vector(),
        Quat(unit(generator), unit(generator), unit(generator), unit(generator)).normalized()};
  };
  constexpr int kSamples = 2000;
  int found = 0;
  for (int i = 0; i < 150; ++i) {
    const Motion motion(pose(), pose());
    const Block box{vector(), Vec3::Constant(0.175), unit(generator) * 3.0};
    const Vec3 drift = vector();
    const auto s = firstContact(motion, kBlade, box, drift, kBladeRadius_m);
    double sampled = 2.0, least = 1e9;
    for (int k = 0; k <= kSamples && sampled > 1.0; ++k) {
      const double share = static_cast<double>(k) / kSamples;
      Block moved = box;
      moved.center_m += share * drift;
      const double gap = distance_m(segmentOf(kBlade, motion.at(share)), moved) - kBladeRadius_m;
      least = std::min(least, gap);
      if (gap <= 0.0) sampled = share;
    }
    if (s && sampled <= 1.0) {
      // Found no later than the sample that shows it, and not before the one in front of it, but
      // for where blade and box move in parallel.
      EXPECT_LE(*s, sampled + 1e-9);
      EXPECT_GE(*s, sampled - 0.05);
      ++found;
    } else if (s) {
      EXPECT_LT(least, 2.0 * kSweepTolerance_m);
    } else {
      EXPECT_GT(sampled, 1.0);
    }
  }
  EXPECT_GT(found, 10);
}

}  // namespace
}  // namespace sim2vr::games::beats

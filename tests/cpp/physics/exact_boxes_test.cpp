// SPDX-License-Identifier: Apache-2.0
// The game's two boxes against a separating-axis test written by hand in double precision: random
// pairs, half of them moved to within 1 mm .. 10 nm of touching, an eighth nearly parallel.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "sim2vr/physics/world.hpp"

namespace sim2vr::physics {
namespace {

using Mat3 = Eigen::Matrix3d;

// Differences between the two tests are allowed where the boxes touch to within this.
constexpr double kTolerance_m = 1e-7;

const Vec3 kHammerHalf(0.05, 0.0275, 0.0275);
const Vec3 kTargetHalf(0.0225, 0.0225, 0.0125);

struct Separation {
  double gap_m = -1e9;  // largest over the 15 axes; negative: depth of penetration
  Vec3 axis = Vec3::Zero();
};

Separation separate(const Pose& a, const Pose& b) {
  const Mat3 a_axes = a.rotation.normalized().toRotationMatrix();
  const Mat3 b_axes = b.rotation.normalized().toRotationMatrix();
  const Vec3 between = b.position - a.position;
  Separation best;
  const auto test = [&](const Vec3& direction) {
    const double length = direction.norm();
    if (length < 1e-9) return;  // parallel edges
    const Vec3 axis = direction / length;
    const double reach = (a_axes.transpose() * axis).cwiseAbs().dot(kHammerHalf) +
                         (b_axes.transpose() * axis).cwiseAbs().dot(kTargetHalf);
    const double gap = std::abs(axis.dot(between)) - reach;
    if (gap > best.gap_m) best = {gap, axis.dot(between) < 0.0 ? Vec3(-axis) : axis};
  };
  for (int i = 0; i < 3; ++i) test(a_axes.col(i));
  for (int i = 0; i < 3; ++i) test(b_axes.col(i));
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) test(a_axes.col(i).cross(b_axes.col(j)));
  }
  return best;
}

class PairMaker {
 public:
  explicit PairMaker(std::uint64_t seed) : bits_(seed) {}

  Vec3 direction() { return Vec3(normal_(bits_), normal_(bits_), normal_(bits_)).normalized(); }
  double uniform(double low, double high) {
    return low + (high - low) * std::generate_canonical<double, 53>(bits_);
  }
  Quat rotation() {
    return Quat(normal_(bits_), normal_(bits_), normal_(bits_), normal_(bits_)).normalized();
  }
  Quat smallRotation() {
    const Vec3 tilt = std::pow(10.0, uniform(-7.0, -3.0)) * direction();
    return Quat(1.0, tilt.x(), tilt.y(), tilt.z()).normalized();
  }
  double signedTinyGap() {
    return std::pow(10.0, uniform(-8.0, -3.0)) * (uniform(0.0, 1.0) < 0.5 ? -1.0 : 1.0);
  }

 private:
  std::mt19937_64 bits_;
  std::normal_distribution<double> normal_;
};

// The game's way to its boxes: local sizes under a scale.
struct Boxes {
  scene::Scene scene;
  scene::GameObject& hammer = scene.create("Hammer");
  scene::GameObject& target = scene.create("Target");
  Collider* hammer_box = nullptr;
  Collider* target_box = nullptr;

  Boxes() {
    hammer.transform().setLocalScale(0.1);
    target.transform().setLocalScale(0.025);
    hammer_box = &hammer.addComponent<Collider>(Box{Vec3(1.0, 0.55, 0.55)});
    target_box = &target.addComponent<Collider>(Box{Vec3(1.8, 1.8, 1.0)}, Vec3::Zero(), true);
  }

  void place(const Pose& hammer_pose, const Pose& target_pose) {
    hammer.transform().setPose(hammer_pose);
    target.transform().setPose(target_pose);
  }
};

void movePairToGap(const Pose& hammer, Pose& target, double gap_m) {
  for (int i = 0; i < 8; ++i) {
    const Separation now = separate(hammer, target);
    target.position += (gap_m - now.gap_m) * now.axis;
  }
}

TEST(ExactBoxes, AgreeWithTheSeparatingAxisTest) {
  PairMaker make(20240917);
  Boxes boxes;
  int overlapping = 0;
  int near_touching = 0;
  int disagreements = 0;
  double worst_m = 0.0;
  for (int i = 0; i < 100'000; ++i) {
    const Pose hammer{Vec3(0.15, 1.1, 0.5) + 0.3 * make.direction(), make.rotation()};
    const Quat turn = i % 8 == 5 ? make.smallRotation() : make.rotation();
    Pose target{hammer.position + make.uniform(0.01, 0.1) * make.direction(),
                (hammer.rotation * turn).normalized()};
    if (i % 2 == 1) movePairToGap(hammer, target, make.signedTinyGap());
    boxes.place(hammer, target);
    const double gap_m = separate(hammer, target).gap_m;
    overlapping += gap_m <= 0.0 ? 1 : 0;
    near_touching += std::abs(gap_m) < 1e-4 ? 1 : 0;
    if (overlaps(*boxes.hammer_box, *boxes.target_box) == (gap_m <= 0.0)) continue;
    ++disagreements;
    worst_m = std::max(worst_m, std::abs(gap_m));
  }
  RecordProperty("disagreements", disagreements);
  RecordProperty("worst_nm", static_cast<int>(worst_m * 1e9));
  EXPECT_GT(overlapping, 30'000);
  EXPECT_GT(near_touching, 30'000);
  EXPECT_LE(worst_m, kTolerance_m) << disagreements << " disagreements";
}

TEST(ExactBoxes, OrderOfThePairDoesNotMatter) {
  PairMaker make(3);
  Boxes boxes;
  for (int i = 0; i < 5'000; ++i) {
    const Pose hammer{make.direction(), make.rotation()};
    Pose target{hammer.position + 0.06 * make.direction(), make.rotation()};
    movePairToGap(hammer, target, make.signedTinyGap());
    boxes.place(hammer, target);
    EXPECT_EQ(overlaps(*boxes.hammer_box, *boxes.target_box),
              overlaps(*boxes.target_box, *boxes.hammer_box));
  }
}

// A target fades in: its box at a hundredth of its size, in front of the hammer's face, edge and
// corner.
TEST(ExactBoxes, TinyTarget) {
  Boxes boxes;
  boxes.target.transform().setLocalScale(0.00025);  // half extents 0.225, 0.225, 0.125 mm
  const auto hit = [&](const Vec3& position) {
    boxes.place({}, {position, Quat::Identity()});
    return overlaps(*boxes.hammer_box, *boxes.target_box);
  };
  const Vec3 corner = kHammerHalf + 0.01 * kTargetHalf;
  for (const double step : {1e-4, 1e-6, 1e-8}) {
    EXPECT_FALSE(hit(Vec3(corner.x() + step, 0, 0)));
    EXPECT_TRUE(hit(Vec3(corner.x() - step, 0, 0)));
    EXPECT_FALSE(hit(Vec3(corner.x() - step, corner.y() + step, 0)));
    EXPECT_TRUE(hit(corner - Vec3::Constant(step)));
    EXPECT_FALSE(hit(corner - Vec3(step, step, -step)));
  }
}

}  // namespace
}  // namespace sim2vr::physics

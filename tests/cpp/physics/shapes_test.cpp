// SPDX-License-Identifier: Apache-2.0
// Hand-derived contacts of spheres, capsules and boxes, each tested a hair (0.1 um) on either side.
#include <gtest/gtest.h>

#include <cmath>

#include "sim2vr/physics/world.hpp"

namespace sim2vr::physics {
namespace {

constexpr double kHair_m = 1e-7;
const Quat kEighthTurnZ(std::cos(M_PI / 8), 0.0, 0.0, std::sin(M_PI / 8));

class Shapes : public ::testing::Test {
 protected:
  // Whether `moving` at `position` overlaps `fixed` at the origin.
  bool hit(const Shape& fixed, const Shape& moving, const Vec3& position,
           const Quat& moving_rotation = Quat::Identity()) {
    scene::Scene scene;
    auto& a = scene.create("A").addComponent<Collider>(fixed);
    auto& b = scene.create("B").addComponent<Collider>(moving);
    b.transform().setPose({position, moving_rotation});
    const bool result = overlaps(a, b);
    EXPECT_EQ(overlaps(b, a), result);
    return result;
  }

  // The contact lies at `distance` along `direction`.
  void expectContact(const Shape& fixed, const Shape& moving, const Vec3& direction,
                     double distance, const Quat& rotation = Quat::Identity()) {
    const Vec3 unit = direction.normalized();
    EXPECT_TRUE(hit(fixed, moving, (distance - kHair_m) * unit, rotation));
    EXPECT_FALSE(hit(fixed, moving, (distance + kHair_m) * unit, rotation));
  }
};

TEST_F(Shapes, SphereSphere) {
  expectContact(Sphere{0.03}, Sphere{0.02}, Vec3(1, 0, 0), 0.05);
  expectContact(Sphere{0.03}, Sphere{0.02}, Vec3(1, -2, 3), 0.05);
  EXPECT_TRUE(hit(Sphere{0.03}, Sphere{0.02}, Vec3::Zero()));
  EXPECT_TRUE(hit(Sphere{0.5}, Sphere{0.5}, Vec3(1, 0, 0))) << "touching counts";
}

TEST_F(Shapes, SphereBox) {
  const Box box{Vec3(0.2, 0.4, 0.6)};
  expectContact(box, Sphere{0.05}, Vec3(1, 0, 0), 0.1 + 0.05);
  expectContact(box, Sphere{0.05}, Vec3(0, 0, -1), 0.3 + 0.05);
  // Towards the corner (0.1, 0.2, 0.3) of length sqrt(0.14).
  expectContact(box, Sphere{0.05}, Vec3(1, 2, 3), std::sqrt(0.14) + 0.05);
  EXPECT_TRUE(hit(box, Sphere{0.001}, Vec3(0.05, 0.1, -0.2))) << "wholly inside";
}

TEST_F(Shapes, BoxBox) {
  const Box unit;
  expectContact(unit, unit, Vec3(1, 0, 0), 1.0);
  // Turned by 45 degrees about z its edge points at the other's face: 0.5 + sqrt(0.5).
  expectContact(unit, unit, Vec3(1, 0, 0), 0.5 + std::sqrt(0.5), kEighthTurnZ);
  // Edge (x y plane, 45 degrees) against the turned box's face: sqrt(0.5) + 0.5.
  expectContact(unit, unit, Vec3(1, 1, 0), std::sqrt(0.5) + 0.5, kEighthTurnZ);
  EXPECT_TRUE(hit(unit, unit, Vec3::Zero()));
  EXPECT_TRUE(hit(unit, unit, Vec3(1, 0, 0))) << "touching counts";
  EXPECT_TRUE(hit(unit, Box{Vec3(0.01, 0.01, 0.01)}, Vec3(0.2, 0.1, 0.3))) << "wholly inside";
}

TEST_F(Shapes, CapsuleSphere) {
  const Capsule capsule{0.1, 0.6, 1};  // line from y = -0.2 to 0.2
  expectContact(capsule, Sphere{0.05}, Vec3(1, 0, 0), 0.15);
  expectContact(capsule, Sphere{0.05}, Vec3(0, 1, 0), 0.2 + 0.15);
  // Beside the line's end at height 0.2: the nearest point is the end, (0.09, 0.12) is 0.15 long.
  EXPECT_TRUE(hit(capsule, Sphere{0.05}, Vec3(0.09, 0.2 + 0.12 - kHair_m, 0)));
  EXPECT_FALSE(hit(capsule, Sphere{0.05}, Vec3(0.09, 0.2 + 0.12 + kHair_m, 0)));
}

TEST_F(Shapes, CapsuleAxes) {
  expectContact(Capsule{0.1, 0.6, 0}, Sphere{0.05}, Vec3(1, 0, 0), 0.35);
  expectContact(Capsule{0.1, 0.6, 2}, Sphere{0.05}, Vec3(0, 0, 1), 0.35);
  expectContact(Capsule{0.1, 0.6, 2}, Sphere{0.05}, Vec3(0, 1, 0), 0.15);
  expectContact(Capsule{0.1, 0.1, 1}, Sphere{0.05}, Vec3(0, 1, 0), 0.15);  // short: a sphere
}

TEST_F(Shapes, CapsuleCapsuleCrossed) {
  // Lines along y and z, each 0.4 long, cross at right angles 0.2 apart.
  expectContact(Capsule{0.1, 0.6, 1}, Capsule{0.1, 0.6, 2}, Vec3(1, 0, 0), 0.2);
}

TEST_F(Shapes, CapsuleBox) {
  expectContact(Box{}, Capsule{0.1, 0.6, 1}, Vec3(0, 1, 0), 0.5 + 0.3);
  expectContact(Box{}, Capsule{0.1, 0.6, 1}, Vec3(0, 0, 1), 0.5 + 0.1);
  // At 45 degrees its line's end, sqrt(0.02) up and beside, comes first.
  expectContact(Box{}, Capsule{0.1, 0.6, 1}, Vec3(1, 0, 0), 0.5 + 0.2 * std::sqrt(0.5) + 0.1,
                kEighthTurnZ);
}

TEST_F(Shapes, FarFromTheOriginAndHugeNextToTiny) {
  scene::Scene scene;
  auto& a = scene.create("A").addComponent<Collider>(Box{Vec3(0.02, 0.02, 0.02)});
  auto& b = scene.create("B").addComponent<Collider>(Box{Vec3(100, 1, 100)});
  a.transform().setPosition(Vec3(1000, 0.51 - kHair_m, 1000));
  b.transform().setPosition(Vec3(1000, 0, 1000));
  EXPECT_TRUE(overlaps(a, b));
  a.transform().setPosition(Vec3(1000, 0.51 + kHair_m, 1000));
  EXPECT_FALSE(overlaps(a, b));
}

TEST_F(Shapes, WithoutSize) {
  const Box nothing{Vec3::Zero()};
  EXPECT_TRUE(hit(Box{}, nothing, Vec3(0.4, 0.4, 0.4)));
  EXPECT_FALSE(hit(Box{}, nothing, Vec3(0.4, 0.6, 0.4)));
  EXPECT_TRUE(hit(nothing, nothing, Vec3::Zero()));
  EXPECT_FALSE(hit(nothing, nothing, Vec3(1e-6, 0, 0)));
}

}  // namespace
}  // namespace sim2vr::physics

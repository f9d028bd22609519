// Does one placed shape touch another? The answers are Bullet's; this file knows how to ask it so
// that they are exact for objects of centimetres.
#pragma once

#include <BulletCollision/CollisionShapes/btBoxShape.h>

#include "sim2vr/core/math.hpp"
#include "sim2vr/physics/collider.hpp"

namespace sim2vr::physics {

/// A collider's shape in the world. Every kind is a box core grown by a radius: a box has radius 0,
/// a sphere's core is a point, a capsule's a line.
class PlacedShape {
 public:
  explicit PlacedShape(const Collider& collider);

  const Pose& pose() const { return pose_; }
  const btBoxShape& core() const { return core_; }
  double radius() const { return radius_; }
  /// Smallest half extent of the core.
  double thickness() const { return thickness_; }
  /// Radius of the sphere about the pose's origin that holds the whole shape.
  double boundingRadius() const { return bounding_radius_; }

 private:
  struct Grown {
    Vec3 half_extents;
    double radius;
  };
  static Grown grow(const Shape& shape, const Vec3& scale);
  PlacedShape(const Pose& pose, const Grown& grown);

  Pose pose_;
  btBoxShape core_;
  double radius_;
  double thickness_;
  double bounding_radius_;
};

/// Touching or penetrating.
bool overlap(const PlacedShape& a, const PlacedShape& b);

}  // namespace sim2vr::physics

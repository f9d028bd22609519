#include "narrowphase.hpp"

#include <BulletCollision/CollisionDispatch/btBoxBoxDetector.h>
#include <BulletCollision/NarrowPhaseCollision/btGjkEpa2.h>
#include <BulletCollision/NarrowPhaseCollision/btPointCollector.h>

#include <algorithm>
#include <array>

#include "sim2vr/scene/game_object.hpp"

namespace sim2vr::physics {
namespace {

// Bullet's box-box detector adds 1e-5 to each product of edge directions: it may call boxes
// overlapping that miss by about that part of their size. Below this part GJK has the last word.
constexpr double kDoubtfulPart = 1e-3;

// For flat boxes the detector may find no contact point: they go to GJK alone.
constexpr double kThinPart = 1e-3;

// From an unlucky first direction GJK stops early, at a distance that is too large. It never
// reports one that is too small, so that several directions and the least distance give the truth.
const std::array<btVector3, 9> kDirections{
    btVector3(0, 0, 0),  // stands for the line between the centres
    btVector3(0, 0, 0),  // and this for its opposite
    btVector3(1, 0, 0),  btVector3(0, 1, 0),  btVector3(0, 0, 1), btVector3(1, 1, 1),
    btVector3(-1, 2, 3), btVector3(3, -2, 1), btVector3(2, 3, -1)};

btVector3 toBullet(const Vec3& v) { return {v.x(), v.y(), v.z()}; }

btTransform toBullet(const Pose& pose) {
  const Quat& q = pose.rotation;
  return btTransform(btQuaternion(q.x(), q.y(), q.z(), q.w()), toBullet(pose.position));
}

// Depth of penetration, m; negative: the boxes certainly miss.
double boxBoxDepth(const btBoxShape& a, const btBoxShape& b, const btTransform& a_T_b) {
  btBoxBoxDetector detector(&a, &b);
  btDiscreteCollisionDetectorInterface::ClosestPointInput input;
  input.m_transformA.setIdentity();
  input.m_transformB = a_T_b;
  btPointCollector deepest;
  detector.getClosestPoints(input, deepest, nullptr);
  return deepest.m_hasResult ? std::max(0.0, -deepest.m_distance) : -1.0;
}

bool coresWithin(const btBoxShape& a, const btBoxShape& b, const btTransform& a_T_b,
                 double distance_m) {
  for (std::size_t i = 0; i < kDirections.size(); ++i) {
    btVector3 direction = kDirections[i];
    if (i == 0) direction = a_T_b.getOrigin();
    if (i == 1) direction = -a_T_b.getOrigin();
    btGjkEpaSolver2::sResults found{};
    if (btGjkEpaSolver2::Distance(&a, btTransform::getIdentity(), &b, a_T_b, direction, found)) {
      if (found.distance <= distance_m) return true;
    } else if (found.status == btGjkEpaSolver2::sResults::Penetrating) {
      return true;
    }
  }
  return false;
}

}  // namespace

PlacedShape::Grown PlacedShape::grow(const Shape& shape, const Vec3& scale) {
  if (const auto* box = std::get_if<Box>(&shape)) {
    return {0.5 * box->size.cwiseProduct(scale), 0.0};
  }
  if (const auto* sphere = std::get_if<Sphere>(&shape)) {
    return {Vec3::Zero(), sphere->radius * scale.maxCoeff()};
  }
  const auto& capsule = std::get<Capsule>(shape);
  const int axis = capsule.axis;
  const double radius = capsule.radius * std::max(scale[(axis + 1) % 3], scale[(axis + 2) % 3]);
  Vec3 half_extents = Vec3::Zero();
  half_extents[axis] = std::max(0.0, 0.5 * capsule.height * scale[axis] - radius);
  return {half_extents, radius};
}

PlacedShape::PlacedShape(const Collider& collider)
    : PlacedShape({collider.transform().transformPoint(collider.center()),
                   collider.transform().rotation().normalized()},
                  grow(collider.shape(), collider.transform().lossyScale().cwiseAbs())) {}

PlacedShape::PlacedShape(const Pose& pose, const Grown& grown)
    : pose_(pose),
      core_(toBullet(grown.half_extents)),
      radius_(grown.radius),
      thickness_(grown.half_extents.minCoeff()),
      bounding_radius_(grown.half_extents.norm() + grown.radius) {
  core_.setMargin(0.0);
}

bool overlap(const PlacedShape& a, const PlacedShape& b) {
  // Relative to one of the two, so that the precision does not depend on the place in the world.
  const Pose a_T_b = a.pose().inverse() * b.pose();
  const double reach = a.boundingRadius() + b.boundingRadius();
  if (a_T_b.position.squaredNorm() > reach * reach * (1.0 + 1e-12)) return false;
  const btTransform relative = toBullet(a_T_b);
  const double radii = a.radius() + b.radius();
  if (radii == 0.0 && std::min(a.thickness(), b.thickness()) > kThinPart * reach) {
    const double depth = boxBoxDepth(a.core(), b.core(), relative);
    if (depth < 0.0) return false;
    if (depth > kDoubtfulPart * reach) return true;
  }
  return coresWithin(a.core(), b.core(), relative, radii);
}

bool overlaps(const Collider& a, const Collider& b) {
  return overlap(PlacedShape(a), PlacedShape(b));
}

}  // namespace sim2vr::physics

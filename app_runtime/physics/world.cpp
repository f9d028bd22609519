// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/physics/world.hpp"

#include <BulletCollision/CollisionDispatch/btBoxBoxDetector.h>
#include <BulletCollision/CollisionShapes/btBoxShape.h>
#include <BulletCollision/NarrowPhaseCollision/btGjkEpa2.h>
#include <BulletCollision/NarrowPhaseCollision/btPointCollector.h>
#include <algorithm>
#include <array>
#include <compare>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/math.hpp"
#include "sim2vr/scene/game_object.hpp"

namespace sim2vr::physics {
namespace {

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

/// Touching or penetrating.
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

// Names a collider across save and load, and distinguishes it from one that was off in between.
struct ColliderKey {
  std::uint64_t object_id = 0;
  std::uint32_t component_index = 0;
  std::uint64_t enable_count = 0;

  auto operator<=>(const ColliderKey&) const = default;
  void fields(Archive& archive) {
    archive.field("object", object_id);
    archive.field("component", component_index);
    archive.field("enable_count", enable_count);
  }
};

using KeyPair = std::pair<ColliderKey, ColliderKey>;

ColliderKey keyOf(const Collider& collider) {
  const auto& components = collider.gameObject().components();
  std::uint32_t index = 0;
  while (components[index].get() != &collider) ++index;
  return {collider.gameObject().id(), index, collider.enableCount()};
}

struct Body {
  Collider* collider;
  ColliderKey key;
  Rigidbody* rigidbody;
  int layer;
  bool is_trigger;
  std::uint64_t transform_revision;
  std::uint64_t collider_revision;
  std::unique_ptr<PlacedShape> shape;  // null until the first step that sees the body
  bool moved = true;
};

struct Pair {
  std::size_t first;  // index of the older collider
  std::size_t second;
  bool before = false;  // overlap in the previous step
  bool now = false;
};

struct Event {
  Collider* first;
  Collider* second;
};

using Callback = void (scene::Component::*)(const scene::TriggerContact&);

void requireLayer(int layer) {
  if (layer < 0 || layer >= kLayers) {
    throw InvalidArgument("layer", std::to_string(layer),
                          "a layer from 0 to " + std::to_string(kLayers - 1));
  }
}

void tellObject(scene::GameObject& object, const Collider& self, Collider& other,
                Callback callback) {
  const scene::TriggerContact contact{&other, other.velocity_mps() - self.velocity_mps()};
  // A callback may add components or switch either collider off.
  for (std::size_t i = 0; i < object.components().size(); ++i) {
    if (!self.isActiveAndEnabled() || !other.isActiveAndEnabled()) return;
    (object.components()[i].get()->*callback)(contact);
  }
}

void tellSide(const Collider& self, Collider& other, Callback callback) {
  scene::GameObject& object = self.gameObject();
  tellObject(object, self, other, callback);
  const Rigidbody* body = self.attachedRigidbody();
  if (body != nullptr && &body->gameObject() != &object) {
    tellObject(body->gameObject(), self, other, callback);
  }
}

void tell(const std::vector<Event>& events, Callback callback) {
  for (const Event& event : events) {
    tellSide(*event.first, *event.second, callback);
    tellSide(*event.second, *event.first, callback);
  }
}

}  // namespace

bool overlaps(const Collider& a, const Collider& b) {
  return overlap(PlacedShape(a), PlacedShape(b));
}

class PhysicsWorld::Impl {
 public:
  explicit Impl(scene::Scene& scene) : scene_(scene) { layer_masks_.fill(~std::uint32_t{0}); }

  void setLayerCollision(int a, int b, bool collide) {
    setBit(a, b, collide);
    setBit(b, a, collide);
    stale_ = true;
  }

  bool layersCollide(int a, int b) const {
    return (layer_masks_[static_cast<std::size_t>(a)] >> b & 1U) != 0;
  }

  void step() {
    const bool rebuilt = stale_ || scene_.structureRevision() != structure_revision_;
    if (rebuilt) rebuild();
    if (!refreshBodies() && !rebuilt && overlaps_.empty()) return;
    findOverlaps();
    sendEvents();
  }

  int overlapCount() const { return static_cast<int>(overlaps_.size()); }

  void fields(Archive& archive) {
    archive.field("layer_masks", layer_masks_);
    archive.field("overlaps", overlaps_);
    if (archive.loading()) stale_ = true;
  }

 private:
  void setBit(int row, int column, bool value) {
    std::uint32_t& mask = layer_masks_[static_cast<std::size_t>(row)];
    mask = value ? mask | (1U << column) : mask & ~(1U << column);
  }

  static int checkedLayer(const Collider& collider) {
    requireLayer(collider.gameObject().layer());
    return collider.gameObject().layer();
  }

  bool mayMeet(const Body& a, const Body& b) const {
    const bool same_body = a.rigidbody == b.rigidbody;  // also: neither has one
    return (a.is_trigger || b.is_trigger) && !same_body && layersCollide(a.layer, b.layer);
  }

  // Lists the bodies and the pairs that the rules allow, and hands the earlier overlaps on to them.
  void rebuild() {
    bodies_.clear();
    scene_.forEach<Collider>([this](Collider& collider) {
      bodies_.push_back({&collider, keyOf(collider), collider.attachedRigidbody(),
                         checkedLayer(collider), collider.isTrigger(), 0, 0, nullptr});
    });
    std::sort(bodies_.begin(), bodies_.end(),
              [](const Body& a, const Body& b) { return a.key < b.key; });
    pairs_.clear();
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      for (std::size_t j = i + 1; j < bodies_.size(); ++j) {
        if (!mayMeet(bodies_[i], bodies_[j])) continue;
        const KeyPair keys(bodies_[i].key, bodies_[j].key);
        const bool before = std::binary_search(overlaps_.begin(), overlaps_.end(), keys);
        pairs_.push_back({i, j, before, before});
      }
    }
    structure_revision_ = scene_.structureRevision();
    stale_ = false;
  }

  // Places the bodies that moved since the last step. False: none did.
  bool refreshBodies() {
    if (rulesChanged()) rebuild();
    bool any_moved = false;
    for (Body& body : bodies_) {
      const std::uint64_t transform_revision = body.collider->transform().revision();
      const std::uint64_t collider_revision = body.collider->revision();
      body.moved = body.shape == nullptr || transform_revision != body.transform_revision ||
                   collider_revision != body.collider_revision;
      if (!body.moved) continue;
      body.shape = std::make_unique<PlacedShape>(*body.collider);
      body.transform_revision = transform_revision;
      body.collider_revision = collider_revision;
      any_moved = true;
    }
    return any_moved;
  }

  // Layers and trigger flags are not part of the scene's structure revision.
  bool rulesChanged() const {
    return std::any_of(bodies_.begin(), bodies_.end(), [](const Body& body) {
      return body.layer != body.collider->gameObject().layer() ||
             body.is_trigger != body.collider->isTrigger();
    });
  }

  void findOverlaps() {
    overlaps_.clear();
    for (Pair& pair : pairs_) {
      const Body& first = bodies_[pair.first];
      const Body& second = bodies_[pair.second];
      pair.before = pair.now;
      if (first.moved || second.moved) pair.now = overlap(*first.shape, *second.shape);
      if (pair.now) overlaps_.emplace_back(first.key, second.key);
    }
  }

  void sendEvents() {
    std::vector<Event> exits;
    std::vector<Event> enters;
    std::vector<Event> stays;
    for (const Pair& pair : pairs_) {
      if (!pair.before && !pair.now) continue;
      auto& events = !pair.now ? exits : pair.before ? stays : enters;
      events.push_back({bodies_[pair.first].collider, bodies_[pair.second].collider});
    }
    tell(exits, &scene::Component::OnTriggerExit);
    tell(enters, &scene::Component::OnTriggerEnter);
    tell(stays, &scene::Component::OnTriggerStay);
  }

  scene::Scene& scene_;
  std::array<std::uint32_t, kLayers> layer_masks_{};
  std::vector<Body> bodies_;
  std::vector<Pair> pairs_;
  std::vector<KeyPair> overlaps_;  // of the latest step, sorted
  std::uint64_t structure_revision_ = 0;
  bool stale_ = true;
};

PhysicsWorld::PhysicsWorld(scene::Scene& scene) : impl_(std::make_unique<Impl>(scene)) {}
PhysicsWorld::~PhysicsWorld() = default;

void PhysicsWorld::setLayerCollision(int a, int b, bool collide) {
  requireLayer(a);
  requireLayer(b);
  impl_->setLayerCollision(a, b, collide);
}

bool PhysicsWorld::layersCollide(int a, int b) const {
  requireLayer(a);
  requireLayer(b);
  return impl_->layersCollide(a, b);
}

void PhysicsWorld::step() { impl_->step(); }
int PhysicsWorld::overlapCount() const { return impl_->overlapCount(); }
void PhysicsWorld::fields(Archive& archive) { impl_->fields(archive); }

}  // namespace sim2vr::physics

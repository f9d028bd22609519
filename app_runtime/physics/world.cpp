#include "sim2vr/physics/world.hpp"

#include <algorithm>
#include <array>
#include <compare>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "narrowphase.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::physics {
namespace {

// Names a collider across save and load, and tells a collider that was off in between from before.
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

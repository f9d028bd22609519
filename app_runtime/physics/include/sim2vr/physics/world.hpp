// SPDX-License-Identifier: Apache-2.0
// Trigger events of a scene's colliders. Bullet decides which shapes overlap.
#pragma once

#include <memory>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/physics/collider.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::physics {

/// Number of layers; a layer is 0 .. kLayers - 1.
inline constexpr int kLayers = 32;

/// Unity's trigger rules:
///  - a pair is tested when its layers collide, at least one collider is a trigger, at least one
///  has a
///    Rigidbody, and the two do not belong to the same Rigidbody;
///  - touching or penetrating counts, with the exact shapes: no margin, no continuous detection;
///  - events go to every component (also disabled ones) of both colliders' objects and of the
///  objects
///    that hold their Rigidbodies;
///  - OnTriggerEnter: overlap now, none in the step before. OnTriggerStay: overlap now and in the
///  step
///    before. OnTriggerExit: no overlap now, one in the step before;
///  - a collider that is switched off, deactivated or destroyed leaves without OnTriggerExit;
///  switched on
///    again within an overlap it enters anew.
/// Order within a step: all exits, all enters, all stays; each by pair, pairs by the colliders'
/// order of creation (object id, then place on the object); the older collider's side first.
/// Overlaps are found before the first callback. Callbacks may create, move, disable or destroy
/// objects: events of a collider that is off by then are dropped.
class PhysicsWorld {
 public:
  /// `scene` must outlive the world.
  explicit PhysicsWorld(scene::Scene& scene);
  ~PhysicsWorld();
  PhysicsWorld(const PhysicsWorld&) = delete;
  PhysicsWorld& operator=(const PhysicsWorld&) = delete;

  /// Whether colliders of layers `a` and `b` meet (both orders). All layers do at first. Throws
  /// InvalidArgument ("layer") outside 0 .. kLayers - 1.
  void setLayerCollision(int a, int b, bool collide);
  bool layersCollide(int a, int b) const;

  /// One fixed step: finds the overlaps with the present transforms and sends the events. Costs
  /// next to nothing while no collider has moved or changed.
  void step();

  /// Number of pairs of colliders that overlapped in the latest step.
  int overlapCount() const;

  /// The overlaps of the latest step. Load it after the scene.
  void fields(Archive& archive);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace sim2vr::physics

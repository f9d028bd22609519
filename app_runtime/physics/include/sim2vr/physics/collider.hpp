// SPDX-License-Identifier: Apache-2.0
// Shapes that the physics world tests for overlap, and the Rigidbody that makes trigger events
// happen.
#pragma once

#include <cstdint>
#include <string_view>
#include <variant>

#include "sim2vr/scene/component.hpp"

namespace sim2vr::physics {

/// Marks an object (with the colliders below it) as a body: a trigger event needs one body at
/// least. Only kinematic bodies exist so far: the Transform moves them, nothing pushes them.
class Rigidbody final : public scene::Component {
 public:
  /// Throws InvalidArgument ("rigidbody.is_kinematic") for a dynamic body.
  explicit Rigidbody(bool is_kinematic = true);

  std::string_view typeName() const override { return "Rigidbody"; }
};

/// Edge lengths in local units.
struct Box {
  Vec3 size = Vec3::Ones();
};

/// Scaled by the largest of the object's three world scales (Unity's rule).
struct Sphere {
  double radius = 0.5;
};

/// Two half spheres and a cylinder. The height includes both caps and is scaled along the axis, the
/// radius by the larger of the other two world scales (Unity's rule); a height below the diameter
/// is a sphere.
struct Capsule {
  double radius = 0.5;
  double height = 2.0;
  int axis = 1;  // 0 x, 1 y, 2 z
};

using Shape = std::variant<Box, Sphere, Capsule>;

/// A shape in the object's local units, placed and scaled by its Transform at every physics step.
/// The object's layer() is the collider's layer.
class Collider final : public scene::Component {
 public:
  /// Throws InvalidArgument naming "collider.size", "collider.radius", "collider.height",
  /// "collider.axis" or "collider.center" for a value that is negative or not finite.
  explicit Collider(const Shape& shape, const Vec3& center = Vec3::Zero(), bool is_trigger = false);

  std::string_view typeName() const override { return "Collider"; }
  /// Late, so that LateUpdate sees the frame's final pose.
  int executionOrder() const override { return 10000; }

  const Shape& shape() const { return shape_; }
  /// Centre of the shape in local units.
  const Vec3& center() const { return center_; }
  bool isTrigger() const { return is_trigger_; }

  /// The Rigidbody of this object or of the nearest ancestor that has one; nullptr for a static
  /// collider.
  Rigidbody* attachedRigidbody() const;

  /// Velocity of the shape's centre between the last two frames, world axes, m/s. Zero before the
  /// collider has been seen in two frames.
  const Vec3& velocity_mps() const { return velocity_; }

  /// Grows when shape, centre or trigger flag are loaded.
  std::uint64_t revision() const { return revision_; }
  /// Grows each time the collider is switched on; an overlap from before counts as new afterwards.
  std::uint64_t enableCount() const { return enable_count_; }

  void OnEnable() override;
  void LateUpdate() override;
  void fields(Archive& archive) override;

 private:
  Shape shape_;
  Vec3 center_;
  bool is_trigger_;
  std::uint64_t revision_ = 1;
  std::uint64_t enable_count_ = 0;
  Vec3 velocity_ = Vec3::Zero();
  Vec3 last_center_world_ = Vec3::Zero();
  bool has_last_center_ = false;
};

/// Whether two colliders overlap with their present transforms: touching or penetrating, no margin.
bool overlaps(const Collider& a, const Collider& b);

}  // namespace sim2vr::physics

// SPDX-License-Identifier: Apache-2.0
// A node's place in the scene tree: local position, rotation and scale relative to the parent.
#pragma once

#include <cstdint>
#include <vector>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/math.hpp"

namespace sim2vr::scene {

class GameObject;

/// Unity's Transform. World scale is the component-wise product along the chain (Unity's
/// lossyScale); shear from rotated non-uniform scales is not represented.
class Transform {
 public:
  explicit Transform(GameObject& owner) : owner_(&owner) {}
  Transform(const Transform&) = delete;
  Transform& operator=(const Transform&) = delete;

  GameObject& gameObject() const { return *owner_; }
  Transform* parent() const { return parent_; }
  const std::vector<Transform*>& children() const { return children_; }

  const Vec3& localPosition() const { return local_position_; }
  const Quat& localRotation() const { return local_rotation_; }
  const Vec3& localScale() const { return local_scale_; }
  void setLocalPosition(const Vec3& position_m);
  void setLocalRotation(const Quat& rotation);
  void setLocalScale(const Vec3& scale);
  void setLocalScale(double uniform_scale) { setLocalScale(Vec3::Constant(uniform_scale)); }

  Vec3 position() const;
  Quat rotation() const;
  Vec3 lossyScale() const;
  Pose pose() const { return {position(), rotation()}; }
  void setPosition(const Vec3& world_position_m);
  void setRotation(const Quat& world_rotation);
  void setPose(const Pose& world_pose);

  /// Local coordinates to world, scale included.
  Vec3 transformPoint(const Vec3& local) const;
  /// World direction of the local +z axis.
  Vec3 forward() const { return rotation() * Vec3::UnitZ(); }
  Vec3 up() const { return rotation() * Vec3::UnitY(); }
  Vec3 right() const { return rotation() * Vec3::UnitX(); }

  /// Grows with every change of this node or an ancestor; equal values mean an unmoved node.
  std::uint64_t revision() const;

  void fields(Archive& archive);

 private:
  friend class GameObject;
  friend class Scene;

  void attachTo(Transform* parent);
  void detach();

  GameObject* owner_;
  Transform* parent_ = nullptr;
  std::vector<Transform*> children_;
  Vec3 local_position_ = Vec3::Zero();
  Quat local_rotation_ = Quat::Identity();
  Vec3 local_scale_ = Vec3::Ones();
  std::uint64_t revision_ = 1;
};

}  // namespace sim2vr::scene

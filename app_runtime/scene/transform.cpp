// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/scene/transform.hpp"

#include <algorithm>

namespace sim2vr::scene {

void Transform::setLocalPosition(const Vec3& position_m) {
  if (local_position_ == position_m) return;
  local_position_ = position_m;
  ++revision_;
}

void Transform::setLocalRotation(const Quat& rotation) {
  if (local_rotation_.coeffs() == rotation.coeffs()) return;
  local_rotation_ = rotation;
  ++revision_;
}

void Transform::setLocalScale(const Vec3& scale) {
  if (local_scale_ == scale) return;
  local_scale_ = scale;
  ++revision_;
}

Vec3 Transform::position() const {
  return parent_ == nullptr ? local_position_ : parent_->transformPoint(local_position_);
}

Quat Transform::rotation() const {
  return parent_ == nullptr ? local_rotation_ : parent_->rotation() * local_rotation_;
}

Vec3 Transform::lossyScale() const {
  return parent_ == nullptr ? local_scale_ : Vec3(parent_->lossyScale().cwiseProduct(local_scale_));
}

void Transform::setPosition(const Vec3& world_position_m) {
  if (parent_ == nullptr) {
    setLocalPosition(world_position_m);
    return;
  }
  const Vec3 offset = parent_->rotation().conjugate() * (world_position_m - parent_->position());
  setLocalPosition(offset.cwiseQuotient(parent_->lossyScale()));
}

void Transform::setRotation(const Quat& world_rotation) {
  setLocalRotation(parent_ == nullptr ? world_rotation
                                      : parent_->rotation().conjugate() * world_rotation);
}

void Transform::setPose(const Pose& world_pose) {
  setPosition(world_pose.position);
  setRotation(world_pose.rotation);
}

Vec3 Transform::transformPoint(const Vec3& local) const {
  const Vec3 in_parent = local_position_ + local_rotation_ * local_scale_.cwiseProduct(local);
  return parent_ == nullptr ? in_parent : parent_->transformPoint(in_parent);
}

std::uint64_t Transform::revision() const {
  return parent_ == nullptr ? revision_ : revision_ + parent_->revision();
}

void Transform::fields(Archive& archive) {
  archive.field("position", local_position_);
  archive.field("rotation", local_rotation_);
  archive.field("scale", local_scale_);
  if (archive.loading()) ++revision_;
}

void Transform::attachTo(Transform* parent) {
  detach();
  parent_ = parent;
  if (parent_ != nullptr) parent_->children_.push_back(this);
  ++revision_;
}

void Transform::detach() {
  if (parent_ == nullptr) return;
  std::erase(parent_->children_, this);
  // The chain below loses the ancestors' share of the revision: keep the sum growing.
  revision_ += parent_->revision();
  parent_ = nullptr;
  ++revision_;
}

}  // namespace sim2vr::scene

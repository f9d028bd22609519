// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/physics/collider.hpp"

#include <array>
#include <cmath>
#include <string>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/scene/game_object.hpp"

namespace sim2vr::physics {
namespace {

void requireSize(const char* field, double value) {
  if (!(std::isfinite(value) && value >= 0.0)) {
    throw InvalidArgument(field, std::to_string(value), "a finite length, 0 or more");
  }
}

void requireValid(const Shape& shape) {
  if (const auto* box = std::get_if<Box>(&shape)) {
    for (const double edge : box->size) requireSize("collider.size", edge);
  } else if (const auto* sphere = std::get_if<Sphere>(&shape)) {
    requireSize("collider.radius", sphere->radius);
  } else if (const auto* capsule = std::get_if<Capsule>(&shape)) {
    requireSize("collider.radius", capsule->radius);
    requireSize("collider.height", capsule->height);
    if (capsule->axis < 0 || capsule->axis > 2) {
      throw InvalidArgument("collider.axis", std::to_string(capsule->axis),
                            "0 (x), 1 (y) or 2 (z)");
    }
  }
}

void requireValid(const Vec3& center) {
  if (!center.allFinite()) throw InvalidArgument("collider.center", "not finite", "three numbers");
}

// A shape as numbers, so that one field list serves all kinds.
struct ShapeNumbers {
  std::uint8_t kind = 0;
  std::array<double, 3> values{};

  explicit ShapeNumbers(const Shape& shape) : kind(static_cast<std::uint8_t>(shape.index())) {
    if (const auto* box = std::get_if<Box>(&shape)) {
      values = {box->size.x(), box->size.y(), box->size.z()};
    } else if (const auto* sphere = std::get_if<Sphere>(&shape)) {
      values = {sphere->radius, 0.0, 0.0};
    } else if (const auto* capsule = std::get_if<Capsule>(&shape)) {
      values = {capsule->radius, capsule->height, static_cast<double>(capsule->axis)};
    }
  }

  Shape shape() const {
    switch (kind) {
      case 0:
        return Box{Vec3(values[0], values[1], values[2])};
      case 1:
        return Sphere{values[0]};
      case 2:
        return Capsule{values[0], values[1], static_cast<int>(values[2])};
      default:
        throw EngineError("saved state: unknown collider shape " + std::to_string(kind));
    }
  }

  void fields(Archive& archive) {
    archive.field("kind", kind);
    archive.field("values", values);
  }
};

}  // namespace

Collider::Collider(const Shape& shape, const Vec3& center, bool is_trigger)
    : shape_(shape), center_(center), is_trigger_(is_trigger) {
  requireValid(shape_);
  requireValid(center_);
}

Rigidbody* Collider::attachedRigidbody() const {
  for (const scene::Transform* node = &transform(); node != nullptr; node = node->parent()) {
    if (auto* body = node->gameObject().getComponent<Rigidbody>()) return body;
  }
  return nullptr;
}

void Collider::OnEnable() {
  ++enable_count_;
  has_last_center_ = false;
  velocity_.setZero();
}

void Collider::LateUpdate() {
  const Vec3 center_world = transform().transformPoint(center_);
  const double dt_s = clock().deltaTime();
  if (has_last_center_ && dt_s > 0.0) velocity_ = (center_world - last_center_world_) / dt_s;
  last_center_world_ = center_world;
  has_last_center_ = true;
}

void Collider::fields(Archive& archive) {
  ShapeNumbers numbers(shape_);
  archive.field("shape", numbers);
  archive.field("center", center_);
  archive.field("is_trigger", is_trigger_);
  archive.field("enable_count", enable_count_);
  archive.field("velocity", velocity_);
  archive.field("last_center_world", last_center_world_);
  archive.field("has_last_center", has_last_center_);
  if (archive.loading()) {
    shape_ = numbers.shape();
    ++revision_;
  }
}

Rigidbody::Rigidbody(bool is_kinematic) {
  if (!is_kinematic) {
    throw InvalidArgument("rigidbody.is_kinematic", "false",
                          "true (dynamic bodies are not simulated yet)");
  }
}

}  // namespace sim2vr::physics

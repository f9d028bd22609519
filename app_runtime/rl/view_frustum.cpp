// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/rl/view_frustum.hpp"

#include <cmath>
#include <numbers>

#include "sim2vr/scene/game_object.hpp"

namespace sim2vr::rl {

bool inView(const render::Camera& camera, double aspect, const Vec3& point_m) {
  // Camera axes: x right, y up, z along the view.
  const Vec3 local = camera.gameObject().transform().pose().inverse() * point_m;
  if (local.z() < camera.near_m || local.z() > camera.far_m) return false;
  const double half_angle = camera.vertical_fov_deg * std::numbers::pi / 360.0;
  const double half_height = local.z() * std::tan(half_angle);
  return std::abs(local.y()) <= half_height && std::abs(local.x()) <= half_height * aspect;
}

}  // namespace sim2vr::rl

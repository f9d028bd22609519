// SPDX-License-Identifier: Apache-2.0
// What rooms of games have in common: a light, a floor, cameras from outside.
#pragma once

#include <span>

#include "sim2vr/render/components.hpp"
#include "sim2vr/rl/outside_cameras.hpp"

namespace sim2vr::rl {

/// Adds "Light", which shines along `direction`.
render::DirectionalLight& addLight(scene::Scene& scene, const Vec3& direction);

/// Adds a camera with the view's path and angle; its pose is the game's to set.
render::Camera& addCamera(scene::Scene& scene, const OutsideView& view);

/// A dark room: the background of these cameras, "Floor" with the given radius, and a light. What
/// is bright in it are the things to look at.
void addDarkRoom(scene::Scene& scene, std::span<render::Camera* const> cameras, double radius_m,
                 const Vec3& light_direction);

}  // namespace sim2vr::rl

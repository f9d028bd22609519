// SPDX-License-Identifier: Apache-2.0
// What rooms of games have in common: a light, a floor, cameras from outside.
#pragma once

#include <span>
#include <string_view>

#include "sim2vr/core/math.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::rl {

// Pictures of a game from outside, for games that bring no cameras for them.

/// Where a camera from outside stands and what it looks at, m from some origin.
struct OutsideView {
  std::string_view path;
  Vec3 place_m;
  Vec3 towards_m;
  double vertical_fov_deg = 50.0;

  Pose from(const Vec3& origin_m) const {
    return {origin_m + place_m, lookAlong(towards_m - place_m)};
  }
};

/// Adds what the round's scene lacks: cameras at kThirdPersonCameraPath and kSpectatorCameraPath,
/// and, with either, something to see for controllers that show nothing (kPlayerLooksLayer).
///
/// The cameras are put up in the round's first frame, relative to where the head is then and where
/// it faces (its heading; pitch and roll do not count), and stay there: the spectator's to the
/// right, behind and above, so that head, hands and what lies within reach are in view; the third
/// person's behind and above, close.
void addOutsideCameras(scene::Scene& scene);

/// Adds "Light", which shines along `direction`.
render::DirectionalLight& addLight(scene::Scene& scene, const Vec3& direction);

/// Adds a camera with the view's path and angle; its pose is the game's to set.
render::Camera& addCamera(scene::Scene& scene, const OutsideView& view);

/// A dark room: the background of these cameras, "Floor" with the given radius, and a light. What
/// is bright in it are the things to look at.
void addDarkRoom(scene::Scene& scene, std::span<render::Camera* const> cameras, double radius_m,
                 const Vec3& light_direction);

}  // namespace sim2vr::rl

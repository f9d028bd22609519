// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/rl/room_looks.hpp"

#include <string>

#include "sim2vr/render/mesh.hpp"

namespace sim2vr::rl {
namespace {

constexpr render::Color kFloor{0.16F, 0.20F, 0.24F, 1.0F};
constexpr render::Color kBackground{0.04F, 0.06F, 0.09F, 1.0F};

}  // namespace

render::DirectionalLight& addLight(scene::Scene& scene, const Vec3& direction) {
  scene::GameObject& light = scene.create("Light");
  light.transform().setLocalRotation(lookAlong(direction));
  return light.addComponent<render::DirectionalLight>();
}

render::Camera& addCamera(scene::Scene& scene, const OutsideView& view) {
  auto& camera = scene.create(std::string(view.path)).addComponent<render::Camera>();
  camera.vertical_fov_deg = view.vertical_fov_deg;
  return camera;
}

void addDarkRoom(scene::Scene& scene, std::span<render::Camera* const> cameras, double radius_m,
                 const Vec3& light_direction) {
  for (render::Camera* camera : cameras) camera->background = kBackground;
  scene::GameObject& floor = scene.create("Floor");
  render::Material stone;
  stone.albedo = kFloor;
  stone.sky_reflections = false;
  stone.specular_highlights = false;
  floor.addComponent<render::MeshRenderer>(render::disc(24), stone);
  // Its front looks along -z.
  floor.transform().setLocalRotation(Quat::FromTwoVectors(-Vec3::UnitZ(), Vec3::UnitY()));
  floor.transform().setLocalScale({radius_m, radius_m, 1.0});
  addLight(scene, light_direction);
}

}  // namespace sim2vr::rl

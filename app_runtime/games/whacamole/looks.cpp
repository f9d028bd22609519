#include "whacamole/looks.hpp"

#include <array>
#include <numbers>
#include <string>

#include "sim2vr/render/components.hpp"
#include "sim2vr/render/mesh.hpp"
#include "sim2vr/rl/xr_rig.hpp"

namespace sim2vr::games::whacamole {
namespace {

using render::Color;
using render::LathePoint;
using render::Material;
using render::MeshPtr;

constexpr double kMetresPerHammerUnit = 0.1;

Color srgb8(float r, float g, float b) { return {r / 255.0F, g / 255.0F, b / 255.0F, 1.0F}; }

Material wood(const Color& color) {
  Material material;
  material.albedo = color;
  material.metallic = 0.5F;
  material.smoothness = 0.4F;
  material.specular_highlights = false;
  material.sky_reflections = false;
  return material;
}

Material translucent(const Color& color, float smoothness) {
  Material material;
  material.albedo = color;
  material.smoothness = smoothness;
  material.blend = Material::Blend::alpha;
  return material;
}

scene::GameObject& addPart(scene::GameObject& parent, const std::string& name, const MeshPtr& mesh,
                           const Material& material) {
  scene::GameObject& part = parent.scene().create(name, &parent);
  part.addComponent<render::MeshRenderer>(mesh, material);
  return part;
}

// Outlines in metres.
MeshPtr hammerHead() {
  static const std::array<LathePoint, 9> outline{{{0.0, -0.0486},
                                                  {0.0279, -0.0486},
                                                  {0.0300, -0.0462},
                                                  {0.0263, -0.0243},
                                                  {0.0244, 0.0},
                                                  {0.0263, 0.0243},
                                                  {0.0300, 0.0462},
                                                  {0.0279, 0.0486},
                                                  {0.0, 0.0486}}};
  static const MeshPtr mesh = render::lathe(outline, 12, "hammer head");
  return mesh;
}

MeshPtr hammerHandle() {
  static const std::array<LathePoint, 10> outline{{{0.0, 0.0},
                                                   {0.0155, 0.0},
                                                   {0.0119, 0.013},
                                                   {0.0091, 0.030},
                                                   {0.0077, 0.057},
                                                   {0.0080, 0.070},
                                                   {0.0116, 0.163},
                                                   {0.0204, 0.169},
                                                   {0.0204, 0.1740},
                                                   {0.0, 0.1747}}};
  static const MeshPtr mesh = render::lathe(outline, 8, "hammer handle");
  return mesh;
}

MeshPtr controllerRing() {
  static const std::array<LathePoint, 2> outline{{{0.046, -0.007}, {0.048, 0.007}}};
  static const MeshPtr mesh = render::lathe(outline, 14, "controller ring");
  return mesh;
}

MeshPtr floorArrow() {
  static const std::array<Vec3, 3> points{Vec3(-0.2, 0.0, 0.0), Vec3(0.0, 0.0, 0.2),
                                          Vec3(0.2, 0.0, 0.0)};
  static const MeshPtr mesh = render::strip(points, 0.018, Vec3::UnitY(), "floor arrow");
  return mesh;
}

Quat lookAlong(const Vec3& direction) {
  const Vec3 forward = direction.normalized();
  const Vec3 right = Vec3::UnitY().cross(forward).normalized();
  Eigen::Matrix3d axes;
  axes << right, forward.cross(right), forward;
  return Quat(axes);
}

render::DirectionalLight& addLight(scene::Scene& scene, const std::string& name, const Vec3& travel,
                                   float intensity) {
  scene::GameObject& object = scene.create(name);
  object.transform().setLocalRotation(lookAlong(travel));
  auto& light = object.addComponent<render::DirectionalLight>();
  light.intensity = intensity;
  return light;
}

void addSky(scene::Scene& scene) {
  auto& sky = scene.create("Sky").addComponent<render::Skybox>();
  sky.atmosphere_thickness = 1.75F;
  sky.exposure = 0.83F;
  sky.sky_tint = {0.132F, 0.132F, 0.132F, 1.0F};
  sky.ground = {0.962F, 0.962F, 0.962F, 1.0F};
}

void addFloor(scene::Scene& scene) {
  Material yellow;
  yellow.albedo = {1.0F, 0.994F, 0.401F, 1.0F};
  yellow.smoothness = 0.1F;
  scene::GameObject& platform = scene.create("Platform");
  platform.transform().setLocalScale({0.45, 0.06, 0.45});
  platform.addComponent<render::MeshRenderer>(render::cylinder(24), yellow);

  scene::GameObject& arrow = scene.create("Floor Arrow");
  arrow.transform().setLocalPosition({0.0, 0.04, 0.2});
  arrow.addComponent<render::MeshRenderer>(floorArrow(),
                                           translucent({0.0F, 1.0F, 0.084F, 0.24F}, 0.5F));
}

render::Camera& addCamera(scene::Scene& scene, std::string_view name, const Vec3& position,
                          const Vec3& direction) {
  scene::GameObject& object = scene.create(std::string(name));
  object.transform().setLocalPosition(position);
  object.transform().setLocalRotation(lookAlong(direction));
  return object.addComponent<render::Camera>();
}

void addCameras(scene::Scene& scene) {
  // The reference's recorder camera.
  render::Camera& recorder =
      addCamera(scene, rl::kThirdPersonCameraPath, {0.0, 1.1, -0.1}, Vec3::UnitZ());
  recorder.vertical_fov_deg = 60.0;
  recorder.far_m = 3.0;
  // Ours, for people: over the player's left shoulder, with the whole area and the hammer in view.
  const Vec3 position(-0.45, 1.4, -0.25);
  render::Camera& spectator =
      addCamera(scene, rl::kSpectatorCameraPath, position, Vec3(0.15, 1.12, 0.48) - position);
  spectator.vertical_fov_deg = 50.0;
}

}  // namespace

void addHammerLooks(scene::GameObject& hammer) {
  scene::GameObject& head = addPart(hammer, "Head", hammerHead(), wood(srgb8(89.0F, 48.0F, 14.0F)));
  head.transform().setLocalPosition({0.0, 1.396, 0.0});
  head.transform().setLocalRotation(
      Quat(Eigen::AngleAxisd(-std::numbers::pi / 2.0, Vec3::UnitZ())));
  head.transform().setLocalScale(1.0 / kMetresPerHammerUnit);
  scene::GameObject& handle =
      addPart(hammer, "Handle", hammerHandle(), wood(srgb8(61.0F, 28.0F, 8.0F)));
  handle.transform().setLocalScale(1.0 / kMetresPerHammerUnit);
}

void addControllerLooks(scene::GameObject& controller) {
  Material plastic = translucent({0.113F, 0.083F, 0.083F, 0.51F}, 0.8F);
  plastic.metallic = 0.5F;
  // The grip runs along the hammer's handle, the tracking ring lies across its upper end.
  const Quat grip_rotation =
      Quat::FromTwoVectors(Vec3::UnitY(), Vec3(0.004690, 0.635087, 0.772427));
  const Vec3 grip_axis = grip_rotation * Vec3::UnitY();
  const Vec3 root(0.0096, -0.0491, -0.0545);
  scene::GameObject& grip = addPart(controller, "Grip", render::capsule(0.019, 0.105, 8), plastic);
  grip.transform().setLocalPosition(root + 0.035 * grip_axis);
  grip.transform().setLocalRotation(grip_rotation);
  plastic.cull_back = false;
  scene::GameObject& ring = addPart(controller, "Ring", controllerRing(), plastic);
  ring.transform().setLocalPosition(root + 0.082 * grip_axis + Vec3(-0.028, 0.0, 0.0));
  ring.transform().setLocalRotation(
      Quat(Eigen::AngleAxisd(-0.25 * std::numbers::pi, Vec3::UnitX())) * grip_rotation);
}

void addAreaLooks(scene::GameObject& area) {
  scene::GameObject& sheet =
      addPart(area, "Sheet", render::box(), translucent({0.211F, 1.0F, 0.0F, 0.255F}, 0.0F));
  sheet.transform().setLocalScale({0.3, 0.3, 0.001});
}

void addRoomLooks(scene::Scene& scene) {
  addLight(scene, "Sun", {-0.466, -0.363, 0.807}, 1.0F);
  // The original scene holds a second light of half the intensity, but its pictures show no trace
  // of it (the colours sampled from them add up to the first light alone), so it is off here as
  // well.
  addLight(scene, "Second Light", {-0.562, -0.595, 0.575}, 0.5F).setEnabled(false);
  addSky(scene);
  addFloor(scene);
  addCameras(scene);
}

}  // namespace sim2vr::games::whacamole

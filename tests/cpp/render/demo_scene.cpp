// SPDX-License-Identifier: Apache-2.0
#include "demo_scene.hpp"

#include <array>
#include <numbers>
#include <vector>

namespace sim2vr::render::demo {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;
const Vec3 kArea{0.1516, 1.0699, 0.5386};
constexpr double kTargetRadius = 0.025;

Quat turned(double degrees, const Vec3& axis) {
  return Quat(Eigen::AngleAxisd(degrees * kDegree, axis));
}

scene::GameObject& shape(scene::Scene& scene, const char* name, scene::GameObject* parent,
                         const MeshPtr& mesh, const Material& material, const Vec3& position,
                         const Vec3& scale = Vec3::Ones(),
                         const Quat& rotation = Quat::Identity()) {
  scene::GameObject& object = scene.create(name, parent);
  object.transform().setLocalPosition(position);
  object.transform().setLocalScale(scale);
  object.transform().setLocalRotation(rotation);
  object.addComponent<MeshRenderer>(mesh, material);
  return object;
}

Material paint(Color color, float smoothness, bool reflections = false) {
  Material material;
  material.albedo = color;
  material.smoothness = smoothness;
  material.sky_reflections = reflections;
  return material;
}

Material glass(Color color, float smoothness) {
  Material material = paint(color, smoothness, true);
  material.blend = Material::Blend::alpha;
  return material;
}

void addLight(scene::Scene& scene, const Vec3& direction, float intensity) {
  scene::GameObject& object = scene.create("Directional Light");
  object.transform().setRotation(Quat::FromTwoVectors(Vec3::UnitZ(), direction));
  object.addComponent<DirectionalLight>().intensity = intensity;
}

void addTarget(scene::Scene& scene, int column, int row, Color color) {
  scene::GameObject& target = scene.create("Target");
  target.transform().setPosition(kArea + Vec3(-0.125 + 0.125 * column, 0.125 - 0.125 * row, 0.025));
  target.transform().setLocalScale(kTargetRadius);
  const Material material = paint(color, 0.5F);
  shape(scene, "Disc", &target, disc(20), material, {0, 0, -1.0585}, {0.948, 0.948, 1});
  // The lathe's axis is y; turned so that its low end faces the player.
  const std::array<LathePoint, 2> bevel = {LathePoint{0.948, -1.0585}, LathePoint{1.0, -1.03}};
  static const MeshPtr rim = lathe(bevel, 20, "bevel");
  shape(scene, "Rim", &target, rim, material, Vec3::Zero(), Vec3::Ones(),
        turned(90, Vec3::UnitX()));
  shape(scene, "Back", &target, hemisphere(20), material, {0, 0, -1.03});
  const Material black = paint({0, 0, 0, 1}, 0.5F);
  shape(scene, "Outer Ring", &target, annulus(0.80, 0.88, 20), black, {0, 0, -1.1});
  shape(scene, "Inner Ring", &target, annulus(0.147, 0.176, 8), black, {0, 0, -1.1});
}

void addHammer(scene::Scene& scene, const Vec3& root, const Quat& rotation) {
  scene::GameObject& hammer = scene.create("Hammer");
  hammer.transform().setPose({root, rotation});
  const auto wood = [](int r, int g, int b) {
    Material material = paint({static_cast<float>(r) / 255.0F, static_cast<float>(g) / 255.0F,
                               static_cast<float>(b) / 255.0F, 1.0F},
                              0.4F);
    material.metallic = 0.5F;
    material.specular_highlights = false;
    return material;
  };
  const std::vector<LathePoint> head = {{0, -.0486},     {.0279, -.0486}, {.03, -.0462},
                                        {.0263, -.0243}, {.0244, 0},      {.0263, .0243},
                                        {.03, .0462},    {.0279, .0486},  {0, .0486}};
  const std::vector<LathePoint> handle = {{0, 0},         {.0155, 0},  {.0119, .013}, {.0091, .03},
                                          {.0077, .057},  {.008, .07}, {.0116, .163}, {.0204, .169},
                                          {.0204, .1747}, {0, .1747}};
  shape(scene, "Head", &hammer, lathe(head, 12, "head"), wood(89, 48, 14), {0, 0.1396, 0},
        Vec3::Ones(), turned(-90, Vec3::UnitZ()));
  shape(scene, "Handle", &hammer, lathe(handle, 8, "handle"), wood(61, 28, 8), Vec3::Zero());
  const Material grey = glass({0.113F, 0.083F, 0.083F, 0.51F}, 0.6F);
  shape(scene, "Controller", &hammer, capsule(0.016, 0.09, 10), grey, {0, 0.02, 0.01});
  shape(scene, "Controller Ring", &hammer, capsule(0.012, 0.08, 10), grey, {-0.03, 0.08, 0.01},
        Vec3::Ones(), turned(90, Vec3::UnitZ()));
}

}  // namespace

void addSurroundings(scene::Scene& scene) {
  auto& sky = scene.create("Sky").addComponent<Skybox>();
  sky.atmosphere_thickness = 1.75F;
  sky.exposure = 0.83F;
  sky.sky_tint = {0.132F, 0.132F, 0.132F, 1.0F};
  sky.ground = {0.962F, 0.962F, 0.962F, 1.0F};
  addLight(scene, {-0.466, -0.363, 0.807}, 1.0F);
}

void addObjects(scene::Scene& scene) {
  addTarget(scene, 0, 1, {0, 1, 0, 1});
  addTarget(scene, 0, 2, {0.46F, 0.54F, 0, 1});
  addTarget(scene, 2, 1, {0.975F, 0.025F, 0, 1});
  shape(scene, "Area", nullptr, quad(), glass({0.211F, 1, 0, 0.255F}, 0.0F), kArea,
        {0.3, 0.3, 1.0});
  shape(scene, "Platform", nullptr, cylinder(32), paint({1, 0.994F, 0.401F, 1}, 0.1F, true),
        Vec3::Zero(), {0.45, 0.06, 0.45});
  const std::array<Vec3, 3> arrow = {Vec3(-0.2, 0.04, 0.2), Vec3(0, 0.04, 0.4),
                                     Vec3(0.2, 0.04, 0.2)};
  shape(scene, "Arrow", nullptr, strip(arrow, 0.018), glass({0, 1, 0.084F, 0.24F}, 0.0F),
        Vec3::Zero());
  addHammer(scene, {0.06, 0.985, 0.46}, turned(-54, Vec3::UnitY()));
  auto& burst = scene.create("Burst").addComponent<Billboards>();
  burst.color = {0.018F, 1, 0, 1};
  for (int i = 0; i < 50; ++i) {
    const double angle = i * 2.4;
    const double radius = 0.018 * i / 50.0;
    burst.billboards.push_back(
        {kArea + Vec3(0.03 + radius * std::cos(angle), -0.02 + radius * std::sin(angle), -0.01),
         0.008 + 0.0001 * i});
  }
}

Camera& addHeadCamera(scene::Scene& scene) {
  scene::GameObject& object = scene.create("Head Camera");
  object.transform().setPose({{0.0016, 1.1699, 0.1386}, turned(10, Vec3::UnitX())});
  return object.addComponent<Camera>();
}

Camera& addFigureCamera(scene::Scene& scene) {
  scene::GameObject& object = scene.create("Figure Camera");
  object.transform().setPose(
      {{0.4536, 1.047, 0.307}, turned(-53.58, Vec3::UnitY()) * turned(-3.88, Vec3::UnitX())});
  auto& camera = object.addComponent<Camera>();
  camera.vertical_fov_deg = 42.82;
  return camera;
}

}  // namespace sim2vr::render::demo

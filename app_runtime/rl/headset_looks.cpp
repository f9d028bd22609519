#include "headset_looks.hpp"

#include <array>
#include <numbers>
#include <string>

#include "sim2vr/render/components.hpp"
#include "sim2vr/render/mesh.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::rl {
namespace {

using render::Color;
using render::LathePoint;
using render::MeshPtr;

constexpr Color kShell{0.20F, 0.21F, 0.23F, 1.0F};
constexpr Color kFoam{0.08F, 0.08F, 0.09F, 1.0F};
constexpr Color kSkin{0.75F, 0.74F, 0.72F, 1.0F};

// Around y, which becomes the direction of view; radius 1 until it is scaled to an oval.
MeshPtr visorMesh() {
  static const std::array<LathePoint, 4> outline{
      {{0.94, -0.045}, {1.0, -0.015}, {0.96, 0.040}, {0.0, 0.047}}};
  static const MeshPtr mesh = render::lathe(outline, 20, "headset visor");
  return mesh;
}

// A level band of radius 1.
MeshPtr strapMesh() {
  static const std::array<LathePoint, 2> outline{{{1.0, -0.016}, {1.0, 0.016}}};
  static const MeshPtr mesh = render::lathe(outline, 20, "headset strap");
  return mesh;
}

scene::GameObject& addPart(scene::GameObject& parent, const std::string& name, int layer,
                           const MeshPtr& mesh, const Color& color) {
  scene::GameObject& part = parent.scene().create(name, &parent);
  part.setLayer(layer);
  render::Material material;
  material.albedo = color;
  part.addComponent<render::MeshRenderer>(mesh, material);
  return part;
}

}  // namespace

void addHeadsetLooks(scene::GameObject& head_camera, int layer) {
  scene::GameObject& headset = head_camera.scene().create("Headset", &head_camera);
  headset.setLayer(layer);
  scene::GameObject& head = addPart(headset, "Head", layer, render::sphere(20), kSkin);
  head.transform().setLocalPosition({0.0, -0.015, -0.09});
  head.transform().setLocalScale({0.078, 0.113, 0.1});
  scene::GameObject& visor = addPart(headset, "Visor", layer, visorMesh(), kShell);
  visor.transform().setLocalRotation(
      Quat(Eigen::AngleAxisd(std::numbers::pi / 2.0, Vec3::UnitX())));
  visor.transform().setLocalScale({0.092, 1.0, 0.058});
  scene::GameObject& strap = addPart(headset, "Strap", layer, strapMesh(), kFoam);
  strap.transform().setLocalPosition({0.0, 0.01, -0.09});
  strap.transform().setLocalScale({0.081, 1.0, 0.103});
}

}  // namespace sim2vr::rl

#include "beats/saber_looks.hpp"

#include <array>
#include <string>

#include "beats/colors.hpp"
#include "beats/saber.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/render/mesh.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr double kHandleRadius_m = 0.016;
constexpr double kHandleEnd_m = -0.08;
constexpr double kHandleTop_m = 0.08;

render::MeshPtr ringMesh() {
  static const std::array<render::LathePoint, 3> outline{
      {{0.030, -0.008}, {0.036, 0.0}, {0.030, 0.008}}};
  static const render::MeshPtr mesh = render::lathe(outline, 10, "saber ring");
  return mesh;
}

// Made around y, shown around z.
scene::Transform& addPart(scene::GameObject& controller, const std::string& name,
                          const render::MeshPtr& mesh, const render::Material& material) {
  scene::GameObject& part = controller.scene().create(name, &controller);
  part.addComponent<render::MeshRenderer>(mesh, material);
  part.transform().setLocalRotation(Quat::FromTwoVectors(Vec3::UnitY(), Vec3::UnitZ()));
  return part.transform();
}

void addRod(scene::GameObject& controller, const std::string& name, double from_m, double to_m,
            double radius_m, const render::Material& material) {
  scene::Transform& rod = addPart(controller, name, render::cylinder(8), material);
  rod.setLocalPosition({0.0, 0.0, (from_m + to_m) / 2.0});
  rod.setLocalScale({radius_m, to_m - from_m, radius_m});
}

}  // namespace

void addSaberLooks(scene::GameObject& controller, Hand hand, const Rod& blade) {
  const render::Color& color = colorOf(hand);
  const render::Color dim{color.r * 0.5F, color.g * 0.5F, color.b * 0.5F, 1.0F};
  addRod(controller, "Handle", kHandleEnd_m, kHandleTop_m, kHandleRadius_m,
         render::unlitMaterial(dim));
  addRod(controller, "Blade", blade.root_m, blade.tip_m, kBladeRadius_m,
         render::unlitMaterial(color));
  render::Material both_sides = render::unlitMaterial(color);
  both_sides.cull_back = false;
  addPart(controller, "Ring", ringMesh(), both_sides).setLocalPosition({0.0, 0.0, kHandleTop_m});
}

}  // namespace sim2vr::games::beats

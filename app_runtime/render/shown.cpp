// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/render/shown.hpp"

#include "sim2vr/core/errors.hpp"
#include "sim2vr/render/components.hpp"

namespace sim2vr::render {
namespace {

std::string pathOf(const scene::GameObject& object) {
  const scene::Transform* parent = object.transform().parent();
  if (parent == nullptr) return object.name();
  return pathOf(parent->gameObject()) + "/" + object.name();
}

Color colorOf(const Material& material) {
  Color color = material.albedo;
  if (material.blend == Material::Blend::opaque) color.a = 1.0F;
  return color;
}

bool shows(const MeshRenderer& renderer) {
  return renderer.isActiveAndEnabled() && renderer.visible && renderer.mesh != nullptr;
}

}  // namespace

int MeshNumbers::of(const MeshPtr& mesh) {
  const auto [found, added] = numbers_.emplace(mesh.get(), static_cast<int>(meshes_.size()));
  if (added) meshes_.push_back(mesh);
  return found->second;
}

const Mesh& MeshNumbers::mesh(int number) const {
  if (number < 0 || number >= static_cast<int>(meshes_.size())) {
    throw InvalidArgument("mesh", std::to_string(number),
                          meshes_.empty() ? "none: nothing was shown yet"
                                          : "0 to " + std::to_string(meshes_.size() - 1));
  }
  return *meshes_[static_cast<std::size_t>(number)];
}

std::vector<Shown> shownBy(const scene::Scene& scene, MeshNumbers& meshes) {
  static const MeshPtr kBall = sphere(8);
  std::vector<Shown> all;
  for (const auto& object : scene.objects()) {
    if (!object->activeInHierarchy()) continue;
    Shown shown{.object = object->id(),
                .path = pathOf(*object),
                .layer = object->layer(),
                .pose = object->transform().pose(),
                .scale = object->transform().lossyScale()};
    const auto* renderer = object->getComponent<MeshRenderer>();
    if (renderer != nullptr && shows(*renderer)) {
      shown.mesh = meshes.of(renderer->mesh);
      shown.color = colorOf(renderer->material);
      shown.unlit = renderer->material.unlit;
    }
    all.push_back(shown);
    const auto* particles = object->getComponent<Billboards>();
    if (particles == nullptr || !particles->isActiveAndEnabled()) continue;
    shown.color = particles->color;
    shown.unlit = true;
    for (const Billboard& each : particles->billboards) {
      shown.mesh = meshes.of(kBall);
      shown.pose = {each.position_world, Quat::Identity()};
      shown.scale = Vec3::Constant(0.5 * each.size_m);
      all.push_back(shown);
    }
  }
  return all;
}

}  // namespace sim2vr::render

// SPDX-License-Identifier: Apache-2.0
#include "panel/shapes.hpp"

namespace sim2vr::games::panel {

render::MeshRenderer& addShape(scene::GameObject& parent, const std::string& name,
                               const render::MeshPtr& mesh, const Vec3& center_m,
                               const Vec3& size_m, const render::Color& color, int layer) {
  constexpr double kLayer_m = 0.001;
  scene::GameObject& shape = parent.scene().create(name, &parent);
  shape.transform().setLocalPosition(center_m - Vec3(0.0, 0.0, kLayer_m * layer));
  shape.transform().setLocalScale(size_m);
  render::Material material = render::unlitMaterial(color);
  material.cull_back = false;
  return shape.addComponent<render::MeshRenderer>(mesh, material);
}

void moveShape(render::MeshRenderer& shape, const Vec3& center_m) {
  Vec3 place = center_m;
  place.z() = shape.transform().localPosition().z();
  shape.transform().setLocalPosition(place);
}

}  // namespace sim2vr::games::panel

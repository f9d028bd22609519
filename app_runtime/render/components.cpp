// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/render/components.hpp"

namespace sim2vr::render {

void MeshRenderer::fields(Archive& archive) {
  archive.field("material", material);
  archive.field("visible", visible);
}

void DirectionalLight::fields(Archive& archive) {
  archive.field("color", color);
  archive.field("intensity", intensity);
}

void Camera::fields(Archive& archive) {
  archive.field("vertical_fov_deg", vertical_fov_deg);
  archive.field("near_m", near_m);
  archive.field("far_m", far_m);
  archive.field("background", background);
}

void Billboards::fields(Archive& archive) {
  archive.field("color", color);
  archive.field("billboards", billboards);
}

void Skybox::fields(Archive& archive) {
  archive.field("atmosphere_thickness", atmosphere_thickness);
  archive.field("exposure", exposure);
  archive.field("sky_tint", sky_tint);
  archive.field("ground", ground);
}

}  // namespace sim2vr::render

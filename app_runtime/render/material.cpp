// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/render/material.hpp"

#include <algorithm>
#include <cmath>

namespace sim2vr::render {

float linearFromSrgb(float encoded) {
  return encoded <= 0.04045F ? encoded / 12.92F : std::pow((encoded + 0.055F) / 1.055F, 2.4F);
}

float srgbFromLinear(float linear) {
  return linear <= 0.0031308F ? linear * 12.92F : 1.055F * std::pow(linear, 1.0F / 2.4F) - 0.055F;
}

Eigen::Vector3f linearRgb(const Color& color) {
  return {linearFromSrgb(color.r), linearFromSrgb(color.g), linearFromSrgb(color.b)};
}

Color lerp(const Color& from, const Color& to, float t) {
  const float s = std::clamp(t, 0.0F, 1.0F);
  const auto mix = [s](float a, float b) { return a + (b - a) * s; };
  return {mix(from.r, to.r), mix(from.g, to.g), mix(from.b, to.b), mix(from.a, to.a)};
}

Material unlitMaterial(const Color& color) {
  Material material;
  material.albedo = color;
  material.unlit = true;
  if (color.a < 1.0F) material.blend = Material::Blend::alpha;
  return material;
}

}  // namespace sim2vr::render

// SPDX-License-Identifier: Apache-2.0
// How a surface looks: the part of Unity's Standard material that the scenes use.
#pragma once

#include <Eigen/Core>

#include "sim2vr/core/archive.hpp"

namespace sim2vr::render {

/// sRGB colour as in Unity's inspector, each channel 0..1; alpha is linear. The renderer converts
/// to linear light.
struct Color {
  float r = 1.0F;
  float g = 1.0F;
  float b = 1.0F;
  float a = 1.0F;

  bool operator==(const Color&) const = default;
  void fields(Archive& archive) {
    archive.field("r", r);
    archive.field("g", g);
    archive.field("b", b);
    archive.field("a", a);
  }
};

/// One sRGB-encoded channel (0..1) to linear light, and back (IEC 61966-2-1).
float linearFromSrgb(float encoded);
float srgbFromLinear(float linear);
/// r, g, b in linear light.
Eigen::Vector3f linearRgb(const Color& color);
/// Mix of two colours, t clamped to [0, 1], in sRGB values as Unity's Color.Lerp.
Color lerp(const Color& from, const Color& to, float t);

struct Material {
  enum class Blend : std::uint8_t {
    opaque,
    /// Unity's "Fade": blended over what lies behind, back to front, in linear light. Depth-tested,
    /// but absent from the depth channel.
    alpha,
  };

  Color albedo;
  /// 0 (paint) to 1 (bare metal).
  float metallic = 0.0F;
  /// 0 (rough) to 1 (mirror).
  float smoothness = 0.5F;
  Blend blend = Blend::opaque;
  /// Hides triangles seen from behind. Switch it off for sheets that are seen from both sides.
  bool cull_back = true;
  /// Shows the albedo as it is, whatever the light.
  bool unlit = false;
  /// Unity's "Specular Highlights": the glint of the main light.
  bool specular_highlights = true;
  /// Unity's "Reflections": the sky mirrored in the surface (three-colour approximation; see
  /// Skybox).
  bool sky_reflections = true;

  bool operator==(const Material&) const = default;
  void fields(Archive& archive) {
    archive.field("albedo", albedo);
    archive.field("metallic", metallic);
    archive.field("smoothness", smoothness);
    archive.field("blend", blend, Blend::alpha);
    archive.field("cull_back", cull_back);
    archive.field("unlit", unlit);
    archive.field("specular_highlights", specular_highlights);
    archive.field("sky_reflections", sky_reflections);
  }
};

/// A colour that is shown as it is, whatever the light; transparent below an alpha of 1.
Material unlitMaterial(const Color& color);

}  // namespace sim2vr::render

// SPDX-License-Identifier: Apache-2.0
// What a scene shows: components that the renderer looks for. They hold data only and may be
// changed between frames; disabled components and inactive objects are not drawn.
#pragma once

#include <cstdint>
#include <string_view>
#include <utility>
#include <vector>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/math.hpp"
#include "sim2vr/render/material.hpp"
#include "sim2vr/render/mesh.hpp"
#include "sim2vr/scene/component.hpp"

namespace sim2vr::render {

/// Base of everything the renderer collects from a scene.
class Renderable : public scene::Component {
 public:
  enum class Kind : std::uint8_t { mesh, light, billboards, skybox };
  virtual Kind kind() const = 0;
};

/// Draws a mesh at the object's transform. The mesh itself is not part of the saved state; a game
/// that swaps meshes restores them from its own fields.
class MeshRenderer : public Renderable {
 public:
  MeshRenderer() = default;
  explicit MeshRenderer(MeshPtr shown_mesh, const Material& shown_material = {})
      : mesh(std::move(shown_mesh)), material(shown_material) {}

  std::string_view typeName() const override { return "MeshRenderer"; }
  Kind kind() const override { return Kind::mesh; }
  void fields(Archive& archive) override;

  /// Null: nothing is drawn.
  MeshPtr mesh;
  Material material;
  bool visible = true;
};

/// Sunlight: parallel light that travels along transform().forward(). The brightest one lights per
/// pixel, with highlights, and is the sky's sun; up to three more light per vertex, without
/// highlights (Unity's "Very Low" quality). No light casts shadows; there is no ambient light.
class DirectionalLight : public Renderable {
 public:
  std::string_view typeName() const override { return "DirectionalLight"; }
  Kind kind() const override { return Kind::light; }
  void fields(Archive& archive) override;

  Color color;
  float intensity = 1.0F;
};

/// Camera::culling_mask of a camera that sees every layer.
inline constexpr std::uint32_t kAllLayers = 0xFFFFFFFFU;

/// Perspective view from the object's pose along its forward axis; scale is ignored.
class Camera : public scene::Component {
 public:
  std::string_view typeName() const override { return "Camera"; }
  void fields(Archive& archive) override;
  /// Whether the culling mask has the layer's bit; true for layers that have none.
  bool sees(int layer) const {
    return layer < 0 || layer > 31 || ((culling_mask >> layer) & 1U) != 0;
  }

  /// Full vertical angle; the horizontal one follows from the image's aspect (square pixels).
  double vertical_fov_deg = 90.0;
  /// Distances of the clipping planes along the view axis; 0 < near_m < far_m. far_m is also the
  /// unit of the depth channel.
  double near_m = 0.01;
  double far_m = 10.0;
  /// Shown where nothing is, in a scene without Skybox.
  Color background{0.0F, 0.0F, 0.0F, 1.0F};
  /// Unity's cullingMask: bit n is for objects on layer n, 0 to 31. What it leaves out has no part
  /// in the picture, neither in colour nor in depth. Set when the scene is built; not part of the
  /// saved state.
  std::uint32_t culling_mask = kAllLayers;
};

/// One camera-facing square.
struct Billboard {
  Vec3 position_world = Vec3::Zero();
  /// Edge length.
  double size_m = 0.0;

  void fields(Archive& archive) {
    archive.field("position_world", position_world);
    archive.field("size_m", size_m);
  }
};

/// Unlit squares that face the camera, drawn in the alpha pass (absent from the depth channel): the
/// particles of an effect.
class Billboards : public Renderable {
 public:
  std::string_view typeName() const override { return "Billboards"; }
  Kind kind() const override { return Kind::billboards; }
  void fields(Archive& archive) override;

  Color color;
  std::vector<Billboard> billboards;
};

/// Unity's procedural sky: light scattered once by a thin shell of air, after O'Neil, "Accurate
/// Atmospheric Scattering" (GPU Gems 2, chapter 16), without sun disc. The sun is the brightest
/// DirectionalLight (straight above in a scene without one). The colours are computed on the CPU
/// when a setting or the sun changes, at the corners of a dome. Defaults: Unity's default sky.
class Skybox : public Renderable {
 public:
  std::string_view typeName() const override { return "Skybox"; }
  Kind kind() const override { return Kind::skybox; }
  void fields(Archive& archive) override;

  /// 0 (no air, black sky) to 5; thick air is red at the horizon.
  float atmosphere_thickness = 1.0F;
  /// Factor on all of it.
  float exposure = 1.3F;
  /// Shifts the wavelengths that scatter.
  Color sky_tint{0.5F, 0.5F, 0.5F, 1.0F};
  Color ground{0.369F, 0.349F, 0.341F, 1.0F};
};

}  // namespace sim2vr::render

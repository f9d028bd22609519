// SPDX-License-Identifier: Apache-2.0
// What one picture needs, gathered from a scene without touching OpenGL.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "mesh_cache.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/render/renderer.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sky.hpp"

namespace sim2vr::render {

using Vec4f = std::array<float, 4>;

/// Uniform block Frame of shaders/frame.glsl (std140).
struct FrameUniforms {
  Vec4f projection;
  Vec4f depth_scale;
  std::array<Vec4f, 3> eye_from_world;
  Vec4f main_direction;
  Vec4f main_color;
  std::array<Vec4f, 3> side_direction;
  std::array<Vec4f, 3> side_color;
  Vec4f up;
  Vec4f sky_high;
  Vec4f sky_horizon;
  Vec4f sky_ground;
};
static_assert(sizeof(FrameUniforms) == 17 * 16, "std140 layout of shaders/frame.glsl");

/// Per-instance attributes of shaders/surface.vert.
struct InstanceData {
  std::array<Vec4f, 3> eye_from_mesh;
  Vec4f normal_scale;
  Vec4f diffuse;
  Vec4f specular;
};

/// Variants of the surface program.
enum class Shading : std::uint8_t { unlit, diffuse, specular };
inline constexpr std::size_t kShadingCount = 3;

/// State that one draw call shares.
struct DrawState {
  Shading shading = Shading::diffuse;
  bool cull_back = true;
  bool mirrored = false;

  auto operator<=>(const DrawState&) const = default;
};

struct DrawItem {
  DrawState state;
  const MeshSlot* mesh = nullptr;
  float distance_m = 0.0F;
  /// In Frame::instances; also the item's place in the scene's order.
  std::uint32_t instance = 0;
};

/// The part of eye space that a picture shows.
struct View {
  float near_m = 0.0F;
  float far_m = 1.0F;
  /// Slopes of the side planes, the wider one where the two sides differ, and the lengths of their
  /// normals (slope, 1).
  float tan_x = 1.0F, tan_y = 1.0F, norm_x = 1.0F, norm_y = 1.0F;
  /// Pixels per metre at a distance of 1 m.
  float pixels = 1.0F;

  /// False only for a sphere that lies outside one of the planes.
  bool sees(const Eigen::Vector3f& centre, float radius) const {
    return centre.z() + radius >= near_m && centre.z() - radius <= far_m &&
           std::abs(centre.x()) - centre.z() * tan_x <= radius * norm_x &&
           std::abs(centre.y()) - centre.z() * tan_y <= radius * norm_y;
  }
};

/// Reused from frame to frame, so that steady play allocates nothing.
struct Frame {
  FrameUniforms uniforms;
  View view;
  std::vector<InstanceData> instances;
  /// Sorted by state, then mesh, in the scene's order of first appearance.
  std::vector<DrawItem> opaque;
  /// Far to near.
  std::vector<DrawItem> alpha;
  bool has_sky = false;
  SkySettings sky;
  std::array<float, 3> background{};
};

class FrameCollector {
 public:
  explicit FrameCollector(MeshCache& meshes) : meshes_(meshes) {}

  /// Fills the frame, sky reflections excepted; what it held before has no part in it. Throws
  /// InvalidArgument for an impossible camera or eye.
  void collect(const ViewRequest& request, Frame& frame);

 private:
  struct Light {
    Vec3 towards_world;
    Eigen::Vector3f radiance;

    float brightness() const { return radiance.sum(); }
  };

  void setCamera(const ViewRequest& request);
  void visit(Renderable& renderable);
  void addMesh(const MeshRenderer& renderer);
  const MeshPtr& detailFor(const MeshPtr& mesh, float scale, float distance_m) const;
  void addLight(const Light& light);
  void addBillboards(const Billboards& billboards);
  void addItem(DrawItem item, MeshSlot& mesh, const InstanceData& instance, Material::Blend blend);
  void setLights();
  void sort();

  MeshCache& meshes_;
  /// The frame that is being filled.
  Frame* frame_ = nullptr;
  /// Bright to dim.
  std::vector<Light> lights_;
  Vec3 eye_position_ = Vec3::Zero();
  Eigen::Matrix3d eye_from_world_ = Eigen::Matrix3d::Identity();
};

}  // namespace sim2vr::render

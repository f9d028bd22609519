// SPDX-License-Identifier: Apache-2.0
// Which meshes are on the GPU: all in one vertex and one index buffer, so that draws share their
// state.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <unordered_map>
#include <vector>

#include "sim2vr/render/mesh.hpp"

namespace sim2vr::render {

/// Place of a mesh in the shared buffers.
struct MeshSlot {
  std::weak_ptr<const Mesh> mesh;
  std::uint32_t first_index = 0;
  std::uint32_t index_count = 0;
  std::int32_t base_vertex = 0;
  std::uint32_t vertex_count = 0;
  Eigen::Vector3f centre = Eigen::Vector3f::Zero();
  float radius = 0.0F;
  /// Set by the collector: number of the frame that used it last, and its rank there.
  std::uint64_t frame = 0;
  std::uint32_t rank = 0;
};

class MeshCache {
 public:
  struct GpuVertex {
    std::array<float, 3> position, normal;
  };

  /// The mesh's place; appends it to the buffers when it is new. References stay valid until
  /// sweep().
  MeshSlot& slot(const MeshPtr& mesh);

  /// Begins a frame; drops meshes that are not held any more once they outweigh the others.
  void beginFrame();
  /// Rank of the slot among those of this frame, in order of first use.
  std::uint32_t rank(MeshSlot& slot);

  const std::vector<GpuVertex>& vertices() const { return vertices_; }
  const std::vector<std::uint32_t>& indices() const { return indices_; }
  std::size_t size() const { return slots_.size(); }
  /// True once after the buffers' content changed.
  bool takeChanged();

 private:
  void append(const Mesh& mesh, MeshSlot& slot);
  void sweep();

  std::unordered_map<const Mesh*, MeshSlot> slots_;
  std::vector<GpuVertex> vertices_;
  std::vector<std::uint32_t> indices_;
  std::uint64_t frame_ = 0;
  std::uint32_t ranks_ = 0;
  bool changed_ = false;
};

}  // namespace sim2vr::render

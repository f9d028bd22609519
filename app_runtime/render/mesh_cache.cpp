// SPDX-License-Identifier: Apache-2.0
#include "mesh_cache.hpp"

#include <algorithm>

namespace sim2vr::render {
namespace {

constexpr std::uint64_t kFramesBetweenSweeps = 512;

std::array<float, 3> floats(const Eigen::Vector3f& v) { return {v.x(), v.y(), v.z()}; }

}  // namespace

MeshSlot& MeshCache::slot(const MeshPtr& mesh) {
  MeshSlot& slot = slots_[mesh.get()];
  // An expired slot belonged to another mesh at the same address.
  if (slot.index_count == 0 || slot.mesh.expired()) {
    slot = MeshSlot{};
    slot.mesh = mesh;
    append(*mesh, slot);
  }
  return slot;
}

void MeshCache::append(const Mesh& mesh, MeshSlot& slot) {
  slot.first_index = static_cast<std::uint32_t>(indices_.size());
  slot.index_count = static_cast<std::uint32_t>(mesh.indices.size());
  slot.base_vertex = static_cast<std::int32_t>(vertices_.size());
  slot.vertex_count = static_cast<std::uint32_t>(mesh.vertices.size());
  Eigen::AlignedBox3f bounds;
  for (const Vertex& vertex : mesh.vertices) {
    vertices_.push_back({floats(vertex.position), floats(vertex.normal)});
    bounds.extend(vertex.position);
  }
  indices_.insert(indices_.end(), mesh.indices.begin(), mesh.indices.end());
  slot.centre = bounds.center();
  for (const Vertex& vertex : mesh.vertices) {
    slot.radius = std::max(slot.radius, (vertex.position - slot.centre).norm());
  }
  changed_ = true;
}

void MeshCache::beginFrame() {
  ++frame_;
  ranks_ = 0;
  if (frame_ % kFramesBetweenSweeps == 0) sweep();
}

std::uint32_t MeshCache::rank(MeshSlot& slot) {
  if (slot.frame != frame_) {
    slot.frame = frame_;
    slot.rank = ranks_++;
  }
  return slot.rank;
}

void MeshCache::sweep() {
  std::size_t live_indices = 0;
  for (auto it = slots_.begin(); it != slots_.end();) {
    if (it->second.mesh.expired()) {
      it = slots_.erase(it);
    } else {
      live_indices += it->second.index_count;
      ++it;
    }
  }
  if (indices_.size() <= 2 * live_indices) return;
  vertices_.clear();
  indices_.clear();
  for (auto& [pointer, slot] : slots_) {
    if (const MeshPtr mesh = slot.mesh.lock()) {
      const std::uint64_t frame = slot.frame;
      slot = MeshSlot{};
      slot.mesh = mesh;
      slot.frame = frame;
      append(*mesh, slot);
    }
  }
}

bool MeshCache::takeChanged() {
  const bool changed = changed_;
  changed_ = false;
  return changed;
}

}  // namespace sim2vr::render

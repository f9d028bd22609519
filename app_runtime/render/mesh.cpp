// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/render/mesh.hpp"

#include <fmt/format.h>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::render {

MeshPtr share(Mesh mesh) {
  if (mesh.indices.empty() || mesh.indices.size() % 3 != 0) {
    throw InvalidArgument(fmt::format("mesh '{}' indices", mesh.name),
                          std::to_string(mesh.indices.size()), "a positive multiple of three");
  }
  for (const std::uint32_t index : mesh.indices) {
    if (index >= mesh.vertices.size()) {
      throw InvalidArgument(fmt::format("mesh '{}' index", mesh.name), std::to_string(index),
                            fmt::format("less than {} (the vertex count)", mesh.vertices.size()));
    }
  }
  for (const Vertex& vertex : mesh.vertices) {
    if (!vertex.position.allFinite() || !vertex.normal.allFinite() || !vertex.uv.allFinite()) {
      throw InvalidArgument(fmt::format("mesh '{}' vertex", mesh.name),
                            "a value that is not finite",
                            "finite positions, normals and texture coordinates");
    }
  }
  float error = 0.0F;
  for (const CoarserMesh& coarser : mesh.coarser) {
    if (coarser.mesh == nullptr || !(coarser.error > error)) {
      throw InvalidArgument(fmt::format("mesh '{}' coarser", mesh.name),
                            fmt::format("an error of {} after {}", coarser.error, error),
                            "meshes with growing errors above 0");
    }
    error = coarser.error;
  }
  return std::make_shared<const Mesh>(std::move(mesh));
}

}  // namespace sim2vr::render

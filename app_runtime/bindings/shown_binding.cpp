#include "shown_binding.hpp"

#include <array>

namespace py = pybind11;

namespace sim2vr::bindings {

ShownColumns shownColumns(const std::vector<render::Shown>& all) {
  const auto count = static_cast<py::ssize_t>(all.size());
  py::array_t<std::uint64_t> objects(count);
  py::array_t<int> layers(count);
  py::array_t<int> meshes(count);
  py::array_t<double> poses({count, py::ssize_t{7}});
  py::array_t<double> scales({count, py::ssize_t{3}});
  py::array_t<float> colors({count, py::ssize_t{4}});
  py::array_t<bool> unlit(count);
  std::vector<std::string> paths;
  for (py::ssize_t i = 0; i < count; ++i) {
    const render::Shown& each = all[static_cast<std::size_t>(i)];
    paths.push_back(each.path);
    objects.mutable_at(i) = each.object;
    layers.mutable_at(i) = each.layer;
    meshes.mutable_at(i) = each.mesh;
    unlit.mutable_at(i) = each.unlit;
    for (int axis = 0; axis < 3; ++axis) {
      poses.mutable_at(i, axis) = each.pose.position[axis];
      scales.mutable_at(i, axis) = each.scale[axis];
    }
    const std::array<float, 4> rgba{each.color.r, each.color.g, each.color.b, each.color.a};
    for (int k = 0; k < 4; ++k) {
      poses.mutable_at(i, 3 + k) = each.pose.rotation.coeffs()[k];
      colors.mutable_at(i, k) = rgba.at(static_cast<std::size_t>(k));
    }
  }
  return {paths, objects, layers, meshes, poses, scales, colors, unlit};
}

MeshArrays meshArrays(const render::Mesh& mesh) {
  const auto corners = static_cast<py::ssize_t>(mesh.vertices.size());
  py::array_t<float> vertices({corners, py::ssize_t{3}});
  for (py::ssize_t i = 0; i < corners; ++i) {
    const Eigen::Vector3f& at = mesh.vertices[static_cast<std::size_t>(i)].position;
    for (int axis = 0; axis < 3; ++axis) vertices.mutable_at(i, axis) = at[axis];
  }
  const py::array_t<std::uint32_t> triangles(
      {static_cast<py::ssize_t>(mesh.triangleCount()), py::ssize_t{3}}, mesh.indices.data());
  return {mesh.name, vertices, triangles};
}

}  // namespace sim2vr::bindings

// What an app shows, as arrays.
#pragma once

#include <pybind11/numpy.h>

#include <string>
#include <tuple>
#include <vector>

#include "sim2vr/render/shown.hpp"

namespace sim2vr::bindings {

/// Paths, objects, layers, meshes, poses, scales, colours, unlit; a row of each per render::Shown.
using ShownColumns =
    std::tuple<std::vector<std::string>, pybind11::array_t<std::uint64_t>, pybind11::array_t<int>,
               pybind11::array_t<int>, pybind11::array_t<double>, pybind11::array_t<double>,
               pybind11::array_t<float>, pybind11::array_t<bool>>;
ShownColumns shownColumns(const std::vector<render::Shown>& all);

/// Name, vertices, triangles.
using MeshArrays =
    std::tuple<std::string, pybind11::array_t<float>, pybind11::array_t<std::uint32_t>>;
MeshArrays meshArrays(const render::Mesh& mesh);

}  // namespace sim2vr::bindings

// SPDX-License-Identifier: Apache-2.0
// What a scene holds and shows, as plain data, for those who draw or measure it elsewhere.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "sim2vr/core/math.hpp"
#include "sim2vr/render/material.hpp"
#include "sim2vr/render/mesh.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::render {

/// Gives every mesh that was ever shown a number, from 0 on, which stays its own; keeps the meshes.
class MeshNumbers {
 public:
  int of(const MeshPtr& mesh);
  std::size_t size() const { return meshes_.size(); }
  /// Throws InvalidArgument("mesh") for a number that was not given.
  const Mesh& mesh(int number) const;

 private:
  std::vector<MeshPtr> meshes_;
  std::map<const Mesh*, int> numbers_;
};

/// An active object, and one thing that it shows. An object that shows several things (particles)
/// comes as often.
struct Shown {
  /// GameObject::id(); never reused within a round.
  std::uint64_t object = 0;
  /// From the root, as Scene::find takes it.
  std::string path;
  int layer = 0;
  /// In MeshNumbers; -1: it shows nothing.
  int mesh = -1;
  /// World, metres, the app's frame.
  Pose pose;
  /// Along the mesh's own axes.
  Vec3 scale = Vec3::Ones();
  /// sRGB; alpha is 1 for an opaque surface.
  Color color = {};
  /// The colour as it is, whatever the light.
  bool unlit = false;
};

/// Every active object in order of creation. Particles, squares that face the camera, come as balls
/// of the same width. Lights, sky and cameras show nothing.
std::vector<Shown> shownBy(const scene::Scene& scene, MeshNumbers& meshes);

}  // namespace sim2vr::render

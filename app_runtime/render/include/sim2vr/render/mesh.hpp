// SPDX-License-Identifier: Apache-2.0
// Triangle meshes and the builders that games make their objects from.
//
// Conventions: the app's frame (Unity: left-handed, x right, y up, z forward). A triangle a, b, c
// shows its front where (b - a) x (c - a) points at the viewer, which is Unity's clockwise order.
// All builders give unit normals that point out of the front. Builders without array arguments keep
// what they built: equal arguments give the same pointer, so that the renderer uploads the geometry
// once. Segment counts are the means to stay fast on a CPU: each triangle costs about 0.1 us per
// view there.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "sim2vr/core/math.hpp"

namespace sim2vr::render {

/// One corner, in mesh coordinates.
struct Vertex {
  Eigen::Vector3f position = Eigen::Vector3f::Zero();
  Eigen::Vector3f normal = Eigen::Vector3f::UnitY();
  Eigen::Vector2f uv = Eigen::Vector2f::Zero();
};

struct Mesh;
using MeshPtr = std::shared_ptr<const Mesh>;

/// A simpler stand-in for a mesh.
struct CoarserMesh {
  MeshPtr mesh;
  /// Largest distance between the two surfaces, in mesh coordinates. The stand-in is drawn where
  /// this is less than half a pixel: in small pictures and far away.
  float error = 0.0F;
};

/// Indexed triangles. Immutable once shared: make a new Mesh instead of changing one.
struct Mesh {
  std::vector<Vertex> vertices;
  /// Three per triangle.
  std::vector<std::uint32_t> indices;
  std::string name;
  /// From fine to coarse; their own `coarser` are not looked at.
  std::vector<CoarserMesh> coarser = {};

  std::size_t triangleCount() const { return indices.size() / 3; }
};

/// Checks the mesh and shares it. Throws InvalidArgument when it has no triangle, when the indices
/// are no multiple of three or point past the vertices, when a coordinate is not finite, or when
/// the errors of coarser meshes do not grow.
MeshPtr share(Mesh mesh);

/// Cube of edge 1 around the origin; 12 triangles.
MeshPtr box();
/// Sphere of radius 1: `segments` around y, half as many from pole to pole. segments in [3, 512].
MeshPtr sphere(int segments = 16);
/// Half of the unit sphere: rim in the plane z = 0, pole at z = +1, open at the rim. `segments`
/// around z, a quarter as many (at least 2) from rim to pole.
MeshPtr hemisphere(int segments = 16);
/// Cylinder of radius 1 and height 1 around the y axis, centred on the origin, with both caps.
MeshPtr cylinder(int segments = 24);
/// Capsule around the y axis, centred on the origin; `height_m` is the total height, at least twice
/// the radius.
MeshPtr capsule(double radius_m, double height_m, int segments = 16);
/// Unit square in the plane z = 0 around the origin, front towards -z (as Unity's quad).
MeshPtr quad();
/// Disc of radius 1 in the plane z = 0, front towards -z.
MeshPtr disc(int segments = 24);
/// Flat ring between two radii (0 <= inner < outer) in the plane z = 0, front towards -z.
MeshPtr annulus(double inner_radius_m, double outer_radius_m, int segments = 24);

/// One point of a lathe's outline.
struct LathePoint {
  double radius_m = 0.0;
  double y_m = 0.0;
};

/// Turns an outline of at least two points, from low to high y, around the y axis; the outside is
/// the front. Neighbouring faces that meet at less than 40 degrees are shaded smoothly, others show
/// an edge. An outline that ends at radius 0 is closed there, else it is open.
MeshPtr lathe(std::span<const LathePoint> profile, int segments = 16,
              const std::string& name = "lathe");

/// Radius of a regular polygon of `segments` corners with the area of one of `finer` corners and
/// radius 1: a coarser surface of revolution of that radius lies as far outside as inside.
double equalAreaRadius(int segments, int finer);

/// Flat band of constant width along a polyline of at least two points, with mitred corners. Lies
/// across `normal` and shows its front to where the normal points.
MeshPtr strip(std::span<const Vec3> points, double width_m, const Vec3& normal = Vec3::UnitY(),
              const std::string& name = "strip");

}  // namespace sim2vr::render

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/render/mesh.hpp"

#include <fmt/format.h>
#include <cmath>
#include <functional>
#include <map>
#include <mutex>
#include <numbers>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::render {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kMaxSegments = 512;
constexpr double kSmoothBelowRad = 40.0 * kPi / 180.0;

MeshPtr cached(const std::string& name, const std::function<void(Mesh&)>& build) {
  static std::mutex mutex;
  static std::map<std::string, MeshPtr> meshes;
  const std::lock_guard lock(mutex);
  MeshPtr& mesh = meshes[name];
  if (mesh == nullptr) {
    Mesh built;
    built.name = name;
    build(built);
    mesh = share(std::move(built));
  }
  return mesh;
}

void checkSegments(int segments) {
  if (segments < 3 || segments > kMaxSegments) {
    throw InvalidArgument("segments", std::to_string(segments),
                          fmt::format("a number from 3 to {}", kMaxSegments));
  }
}

void checkPositive(const char* field, double value) {
  if (!(std::isfinite(value) && value > 0.0)) {
    throw InvalidArgument(field, fmt::format("{}", value), "a finite number above 0");
  }
}

std::uint32_t add(Mesh& mesh, const Vec3& position, const Vec3& normal, double u, double v) {
  mesh.vertices.push_back(
      {position.cast<float>(), normal.cast<float>(), Eigen::Vector2d(u, v).cast<float>()});
  return static_cast<std::uint32_t>(mesh.vertices.size() - 1);
}

/// Adds a triangle with its front towards its vertices' normals; leaves out one without area.
void addTriangle(Mesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  const auto& v = mesh.vertices;
  const Eigen::Vector3f across =
      (v[b].position - v[a].position).cross(v[c].position - v[a].position);
  if (across.norm() < 1e-12F) return;
  if (across.dot(v[a].normal + v[b].normal + v[c].normal) < 0.0F) std::swap(b, c);
  mesh.indices.insert(mesh.indices.end(), {a, b, c});
}

void addQuad(Mesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
  addTriangle(mesh, a, b, c);
  addTriangle(mesh, a, c, d);
}

/// One point of an outline with the outline's own normal there (radial and axial part).
struct OutlinePoint {
  double radius, height;
  double normal_radial, normal_axial;
};

/// Where a turned outline puts its points: around y, or around z for hemispheres.
using Axes = std::function<Vec3(double radial_cos, double radial_sin, double axial)>;
Vec3 aroundY(double c, double s, double axial) { return {c, axial, s}; }
Vec3 aroundZ(double c, double s, double axial) { return {c, s, axial}; }

/// Surface of revolution through one smooth run of outline points.
void addTurned(Mesh& mesh, std::span<const OutlinePoint> outline, int segments, const Axes& axes) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  const auto columns = static_cast<std::uint32_t>(segments) + 1;
  for (std::size_t row = 0; row < outline.size(); ++row) {
    const OutlinePoint& p = outline[row];
    for (std::uint32_t column = 0; column < columns; ++column) {
      const double angle = 2.0 * kPi * (column % static_cast<std::uint32_t>(segments)) / segments;
      const double c = std::cos(angle);
      const double s = std::sin(angle);
      add(mesh, axes(p.radius * c, p.radius * s, p.height),
          axes(p.normal_radial * c, p.normal_radial * s, p.normal_axial).normalized(),
          static_cast<double>(column) / segments,
          static_cast<double>(row) / static_cast<double>(outline.size() - 1));
    }
  }
  for (std::uint32_t row = 0; row + 1 < outline.size(); ++row) {
    for (std::uint32_t column = 0; column < static_cast<std::uint32_t>(segments); ++column) {
      const std::uint32_t a = first + row * columns + column;
      addQuad(mesh, a, a + 1, a + columns + 1, a + columns);
    }
  }
}

/// Circular arc of an outline; angles measured from the plane across the axis.
std::vector<OutlinePoint> arc(double radius, double centre, double from_rad, double to_rad,
                              int steps) {
  std::vector<OutlinePoint> points;
  for (int i = 0; i <= steps; ++i) {
    const double angle = from_rad + (to_rad - from_rad) * i / steps;
    const double c = std::abs(std::abs(angle) - kPi / 2) < 1e-12 ? 0.0 : std::cos(angle);
    points.push_back({radius * c, centre + radius * std::sin(angle), c, std::sin(angle)});
  }
  return points;
}

struct Direction {
  double radial, axial;  // unit normal of one outline segment
};

std::vector<Direction> segmentNormals(std::span<const LathePoint> profile) {
  std::vector<Direction> normals;
  for (std::size_t i = 0; i + 1 < profile.size(); ++i) {
    const double dr = profile[i + 1].radius_m - profile[i].radius_m;
    const double dy = profile[i + 1].y_m - profile[i].y_m;
    const double length = std::hypot(dr, dy);
    if (length < 1e-9) {
      throw InvalidArgument(fmt::format("profile[{}]", i + 1), "the point before it again",
                            "distinct neighbouring points");
    }
    normals.push_back({dy / length, -dr / length});
  }
  return normals;
}

void checkProfile(std::span<const LathePoint> profile) {
  if (profile.size() < 2) {
    throw InvalidArgument("profile", fmt::format("{} points", profile.size()), "at least 2 points");
  }
  for (const LathePoint& point : profile) {
    if (!(std::isfinite(point.y_m) && std::isfinite(point.radius_m) && point.radius_m >= 0.0)) {
      throw InvalidArgument("profile", fmt::format("radius {}, y {}", point.radius_m, point.y_m),
                            "finite values, radius 0 or more");
    }
  }
}

/// Normals at both ends of segment i, averaged with a neighbour where the outline bends little.
OutlinePoint profilePoint(std::span<const LathePoint> profile,
                          const std::vector<Direction>& normals, std::size_t segment, bool end) {
  const std::size_t point = segment + (end ? 1 : 0);
  Direction normal = normals[segment];
  const std::size_t other = end ? segment + 1 : segment - 1;
  if (end ? other < normals.size() : segment > 0) {
    const double cosine =
        normal.radial * normals[other].radial + normal.axial * normals[other].axial;
    if (cosine > std::cos(kSmoothBelowRad)) {
      normal.radial += normals[other].radial;
      normal.axial += normals[other].axial;
    }
  }
  return {profile[point].radius_m, profile[point].y_m, normal.radial, normal.axial};
}

/// Ring from `inner` to `outer` radius in a plane across `axis_sign` times the axis.
void addRing(Mesh& mesh, double inner, double outer, double height, double axis_sign, int segments,
             const Axes& axes) {
  const OutlinePoint rows[] = {{inner, height, 0.0, axis_sign}, {outer, height, 0.0, axis_sign}};
  addTurned(mesh, rows, segments, axes);
}

}  // namespace

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

// Mesh builders. Surfaces are grids of points; a cache keeps one mesh per set of arguments.

MeshPtr box() {
  return cached("box", [](Mesh& mesh) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const double sign : {-1.0, 1.0}) {
        const Vec3 n = sign * Vec3::Unit(axis);
        const Vec3 u = 0.5 * Vec3::Unit((axis + 1) % 3);
        const Vec3 v = 0.5 * Vec3::Unit((axis + 2) % 3);
        const auto a = add(mesh, 0.5 * n - u - v, n, 0, 0);
        add(mesh, 0.5 * n + u - v, n, 1, 0);
        add(mesh, 0.5 * n + u + v, n, 1, 1);
        add(mesh, 0.5 * n - u + v, n, 0, 1);
        addQuad(mesh, a, a + 1, a + 2, a + 3);
      }
    }
  });
}

MeshPtr sphere(int segments) {
  checkSegments(segments);
  return cached(fmt::format("sphere({})", segments), [&](Mesh& mesh) {
    addTurned(mesh, arc(1.0, 0.0, -kPi / 2, kPi / 2, std::max(2, segments / 2)), segments, aroundY);
  });
}

MeshPtr hemisphere(int segments) {
  checkSegments(segments);
  return cached(fmt::format("hemisphere({})", segments), [&](Mesh& mesh) {
    addTurned(mesh, arc(1.0, 0.0, 0.0, kPi / 2, std::max(2, segments / 4)), segments, aroundZ);
  });
}

MeshPtr cylinder(int segments) {
  checkSegments(segments);
  return cached(fmt::format("cylinder({})", segments), [&](Mesh& mesh) {
    const OutlinePoint side[] = {{1.0, -0.5, 1.0, 0.0}, {1.0, 0.5, 1.0, 0.0}};
    addRing(mesh, 0.0, 1.0, -0.5, -1.0, segments, aroundY);
    addTurned(mesh, side, segments, aroundY);
    addRing(mesh, 0.0, 1.0, 0.5, 1.0, segments, aroundY);
  });
}

MeshPtr capsule(double radius_m, double height_m, int segments) {
  checkSegments(segments);
  checkPositive("radius_m", radius_m);
  if (!(std::isfinite(height_m) && height_m >= 2.0 * radius_m)) {
    throw InvalidArgument("height_m", fmt::format("{}", height_m),
                          fmt::format("at least twice the radius {}", radius_m));
  }
  return cached(fmt::format("capsule({}, {}, {})", radius_m, height_m, segments), [&](Mesh& mesh) {
    const double centre = height_m / 2.0 - radius_m;
    const int steps = std::max(2, segments / 4);
    std::vector<OutlinePoint> outline = arc(radius_m, -centre, -kPi / 2, 0.0, steps);
    const std::vector<OutlinePoint> top = arc(radius_m, centre, 0.0, kPi / 2, steps);
    outline.insert(outline.end(), top.begin(), top.end());
    addTurned(mesh, outline, segments, aroundY);
  });
}

MeshPtr quad() {
  return cached("quad", [](Mesh& mesh) {
    const Vec3 n = -Vec3::UnitZ();
    add(mesh, {-0.5, -0.5, 0.0}, n, 0, 0);
    add(mesh, {-0.5, 0.5, 0.0}, n, 0, 1);
    add(mesh, {0.5, 0.5, 0.0}, n, 1, 1);
    add(mesh, {0.5, -0.5, 0.0}, n, 1, 0);
    addQuad(mesh, 0, 1, 2, 3);
  });
}

MeshPtr disc(int segments) {
  checkSegments(segments);
  return cached(fmt::format("disc({})", segments), [&](Mesh& mesh) {
    for (int i = 0; i < segments; ++i) {
      const double angle = 2.0 * kPi * i / segments;
      const double c = std::cos(angle);
      const double s = std::sin(angle);
      add(mesh, {c, s, 0.0}, -Vec3::UnitZ(), 0.5 + 0.5 * c, 0.5 + 0.5 * s);
    }
    // A fan from a rim point needs no centre and two triangles fewer than one from the middle.
    for (int i = 1; i + 1 < segments; ++i) {
      addTriangle(mesh, 0, static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(i + 1));
    }
  });
}

MeshPtr annulus(double inner_radius_m, double outer_radius_m, int segments) {
  checkSegments(segments);
  checkPositive("outer_radius_m", outer_radius_m);
  if (!(inner_radius_m >= 0.0 && inner_radius_m < outer_radius_m)) {
    throw InvalidArgument(
        "inner_radius_m", fmt::format("{}", inner_radius_m),
        fmt::format("at least 0 and less than the outer radius {}", outer_radius_m));
  }
  return cached(fmt::format("annulus({}, {}, {})", inner_radius_m, outer_radius_m, segments),
                [&](Mesh& mesh) {
                  addRing(mesh, inner_radius_m, outer_radius_m, 0.0, -1.0, segments, aroundZ);
                });
}

MeshPtr lathe(std::span<const LathePoint> profile, int segments, const std::string& name) {
  checkSegments(segments);
  checkProfile(profile);
  const std::vector<Direction> normals = segmentNormals(profile);
  Mesh mesh;
  mesh.name = name;
  std::vector<OutlinePoint> run{profilePoint(profile, normals, 0, false)};
  for (std::size_t i = 0; i < normals.size(); ++i) {
    run.push_back(profilePoint(profile, normals, i, true));
    if (i + 1 == normals.size()) break;
    const OutlinePoint next = profilePoint(profile, normals, i + 1, false);
    const OutlinePoint& last = run.back();
    if (std::abs(next.normal_radial - last.normal_radial) > 1e-9 ||
        std::abs(next.normal_axial - last.normal_axial) > 1e-9) {
      addTurned(mesh, run, segments, aroundY);
      run.assign(1, next);
    }
  }
  addTurned(mesh, run, segments, aroundY);
  return share(std::move(mesh));
}

double equalAreaRadius(int segments, int finer) {
  const auto area = [](int corners) { return corners * std::sin(2.0 * kPi / corners); };
  return std::sqrt(area(finer) / area(segments));
}

MeshPtr strip(std::span<const Vec3> points, double width_m, const Vec3& normal,
              const std::string& name) {
  if (points.size() < 2) {
    throw InvalidArgument("points", fmt::format("{} points", points.size()), "at least 2 points");
  }
  checkPositive("width_m", width_m);
  if (!(normal.allFinite() && normal.norm() > 1e-9)) {
    throw InvalidArgument("normal", "no direction", "a finite vector longer than 0");
  }
  Mesh mesh;
  mesh.name = name;
  const Vec3 n = normal.normalized();
  const auto sideways = [&](std::size_t i) {
    return n.cross(points[i + 1] - points[i]).normalized();
  };
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3 before = sideways(i == 0 ? 0 : i - 1);
    const Vec3 after = sideways(i + 1 == points.size() ? i - 1 : i);
    const Vec3 mitre = (before + after).normalized();
    // A mitre grows without bound at a hairpin; it stops at four widths.
    const Vec3 half = 0.5 * width_m / std::max(0.25, mitre.dot(after)) * mitre;
    const double along = static_cast<double>(i) / static_cast<double>(points.size() - 1);
    add(mesh, points[i] - half, n, 0, along);
    add(mesh, points[i] + half, n, 1, along);
  }
  for (std::uint32_t i = 0; i + 1 < points.size(); ++i) {
    addQuad(mesh, 2 * i, 2 * i + 1, 2 * i + 3, 2 * i + 2);
  }
  return share(std::move(mesh));
}

}  // namespace sim2vr::render

// SPDX-License-Identifier: Apache-2.0
#include "whacamole/target_looks.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "sim2vr/render/mesh.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::games::whacamole {
namespace {

using render::Color;
using render::MeshPtr;

constexpr Color kFresh{0.0F, 1.0F, 0.0F, 1.0F};
constexpr Color kOld{1.0F, 0.0F, 0.0F, 1.0F};
constexpr Color kBlack{0.0F, 0.0F, 0.0F, 1.0F};
constexpr Color kSpark{0.018F, 1.0F, 0.0F, 1.0F};

// In target units (radii); z runs from the player into the depth.
constexpr float kDisc_z = -1.0585F;
constexpr float kRings_z = -1.1F;

// Around the axis, of body and outer ring.
constexpr int kSegments = 16;

constexpr int kSparks = 50;
constexpr double kSparkLife_s = 0.3;

// Turns a mesh made around y into one around z, low y towards the player.
MeshPtr facingPlayer(const MeshPtr& lathe) {
  render::Mesh mesh = *lathe;
  const auto turn = [](const Eigen::Vector3f& v) { return Eigen::Vector3f(v.x(), -v.z(), v.y()); };
  for (render::Vertex& vertex : mesh.vertices) {
    vertex.position = turn(vertex.position);
    vertex.normal = turn(vertex.normal);
  }
  return render::share(std::move(mesh));
}

// The disc's edge, where the dome begins; also the dome's centre.
constexpr float kRim_z = -1.03F;

// A lathe of few rows would shade the dome as cones.
void roundDome(render::Mesh& mesh) {
  const Eigen::Vector3f center(0.0F, 0.0F, kRim_z);
  for (render::Vertex& vertex : mesh.vertices) {
    const bool on_dome = vertex.normal.z() > 0.0F;
    if (on_dome) vertex.normal = (vertex.position - center).normalized();
  }
}

// Without the bevel; the disc's edge keeps the mean of the normals that a bevel gives it.
void bendDisc(render::Mesh& mesh) {
  for (render::Vertex& vertex : mesh.vertices) {
    const bool on_disc = vertex.normal.z() < -0.99F;
    const Eigen::Vector3f outwards(vertex.position.x(), vertex.position.y(), 0.0F);
    if (on_disc) vertex.normal = (vertex.normal + 0.26F * outwards).normalized();
  }
}

// A body for distances at which it measures a few pixels, of equal area.
MeshPtr coarseBody(int segments) {
  const double rim = render::equalAreaRadius(segments, kSegments);
  const double row = rim * 1.04 * std::numbers::sqrt2 / 2.0;
  const std::array<render::LathePoint, 4> outline{
      {{0.0, kDisc_z}, {rim, kDisc_z}, {row, kRim_z + row}, {0.0, kRim_z + 1.0}}};
  render::Mesh body = *facingPlayer(
      render::lathe(outline, segments, fmt::format("target ({} segments)", segments)));
  roundDome(body);
  bendDisc(body);
  return render::share(std::move(body));
}

// Flat disc with a bevel, and a dome behind it. The one row of corners between the dome's rim and
// its pole lies a little outside, so that the outline is as far inside the half circle as outside.
MeshPtr bodyMesh() {
  static const MeshPtr mesh = [] {
    constexpr double kRow = 1.04 * std::numbers::sqrt2 / 2.0;
    static const std::array<render::LathePoint, 5> outline{{{0.0, kDisc_z},
                                                            {0.948, kDisc_z},
                                                            {1.0, kRim_z},
                                                            {kRow, kRim_z + kRow},
                                                            {0.0, kRim_z + 1.0}}};
    render::Mesh body = *facingPlayer(render::lathe(outline, kSegments, "target"));
    roundDome(body);
    body.coarser = {{coarseBody(8), 0.06F}, {coarseBody(6), 0.11F}};
    return render::share(std::move(body));
  }();
  return mesh;
}

void append(render::Mesh& mesh, const render::Mesh& other) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), other.vertices.begin(), other.vertices.end());
  for (const std::uint32_t index : other.indices) mesh.indices.push_back(first + index);
}

// Both rings in one mesh; an inner one of 0 segments is a dot of the same area.
MeshPtr ringsOf(int outer_segments, int inner_segments, const std::string& name,
                std::vector<render::CoarserMesh> coarser = {}) {
  constexpr double kInner = 0.147, kOuter = 0.176;
  const double grown = render::equalAreaRadius(outer_segments, kSegments);
  render::Mesh both = *render::annulus(0.80 * grown, 0.88 * grown, outer_segments);
  if (inner_segments == 0) {
    render::Mesh dot = *render::disc(3);
    const double radius =
        std::sqrt(kOuter * kOuter - kInner * kInner) * render::equalAreaRadius(3, kSegments / 2);
    for (render::Vertex& vertex : dot.vertices) vertex.position *= static_cast<float>(radius);
    append(both, dot);
  } else {
    const double inner_grown = render::equalAreaRadius(inner_segments, kSegments / 2);
    append(both, *render::annulus(kInner * inner_grown, kOuter * inner_grown, inner_segments));
  }
  for (render::Vertex& vertex : both.vertices) vertex.position.z() += kRings_z;
  both.name = name;
  both.coarser = std::move(coarser);
  return render::share(std::move(both));
}

MeshPtr ringsMesh() {
  static const MeshPtr mesh = ringsOf(kSegments, kSegments / 2, "target rings",
                                      {{ringsOf(8, 4, "target rings (8 segments)"), 0.06F},
                                       {ringsOf(6, 0, "target rings (6 segments)"), 0.11F}});
  return mesh;
}

render::Material paint(const Color& color) {
  render::Material material;
  material.albedo = color;
  material.sky_reflections = false;
  return material;
}

// Directions evenly spread over the half away from the player; no random numbers, so that looks
// cannot change a round.
Vec3 sparkDirection(int i) {
  const double height = (2.0 * i + 1.0) / (2.0 * kSparks);
  const double angle = i * std::numbers::pi * (3.0 - std::sqrt(5.0));
  const double radius = std::sqrt(1.0 - height * height);
  return {radius * std::cos(angle), radius * std::sin(angle), height};
}

// Distance flown: 0.9 m/s, quickly damped to a tenth of it.
double sparkTravel_m(double t_s) {
  constexpr double kFinalSpeed = 0.09;
  constexpr double kExtraSpeed = 0.81;
  constexpr double kDamping_s = 0.01;
  return kFinalSpeed * t_s + kExtraSpeed * kDamping_s * (1.0 - std::exp(-t_s / kDamping_s));
}

double sparkSize_m(int i, double t_s) {
  const double spread = std::fmod(i * std::numbers::phi, 1.0);
  return (0.0075 + 0.0225 * spread) * (1.0 - t_s / kSparkLife_s);
}

}  // namespace

void TargetLooks::Awake() {
  body_ = &gameObject().addComponent<render::MeshRenderer>(bodyMesh(), paint(kFresh));
  sparks_ = &gameObject().addComponent<render::Billboards>();
  sparks_->color = kSpark;
  rings_ = &scene()
                .create("Rings", &gameObject())
                .addComponent<render::MeshRenderer>(ringsMesh(), paint(kBlack));
}

void TargetLooks::showAge(float fraction) {
  body_->material.albedo = render::lerp(kFresh, kOld, fraction);
}

void TargetLooks::showMissed() { body_->material.albedo = kBlack; }

void TargetLooks::showBurst(float elapsed_s) {
  body_->visible = false;
  rings_->visible = false;
  sparks_->billboards.clear();
  if (elapsed_s >= kSparkLife_s) return;
  constexpr double kStartRadius_m = 0.003;
  const Vec3 center = transform().transformPoint({0.0, 0.0, kDisc_z});
  const Quat rotation = transform().rotation();
  for (int i = 0; i < kSparks; ++i) {
    const double start = kStartRadius_m * std::fmod(i * std::numbers::sqrt3, 1.0);
    const Vec3 flown = sparkDirection(i) * (start + sparkTravel_m(elapsed_s));
    sparks_->billboards.push_back({center + rotation * flown, sparkSize_m(i, elapsed_s)});
  }
}

}  // namespace sim2vr::games::whacamole

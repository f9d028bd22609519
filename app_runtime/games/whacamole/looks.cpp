// SPDX-License-Identifier: Apache-2.0
#include "whacamole/looks.hpp"

#include <fmt/format.h>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "sim2vr/render/mesh.hpp"
#include "sim2vr/rl/xr_rig.hpp"

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

using render::Color;
using render::LathePoint;
using render::Material;
using render::MeshPtr;

constexpr double kMetresPerHammerUnit = 0.1;

Color srgb8(float r, float g, float b) { return {r / 255.0F, g / 255.0F, b / 255.0F, 1.0F}; }

Material wood(const Color& color) {
  Material material;
  material.albedo = color;
  material.metallic = 0.5F;
  material.smoothness = 0.4F;
  material.specular_highlights = false;
  material.sky_reflections = false;
  return material;
}

Material translucent(const Color& color, float smoothness) {
  Material material;
  material.albedo = color;
  material.smoothness = smoothness;
  material.blend = Material::Blend::alpha;
  return material;
}

scene::GameObject& addPart(scene::GameObject& parent, const std::string& name, const MeshPtr& mesh,
                           const Material& material) {
  scene::GameObject& part = parent.scene().create(name, &parent);
  part.addComponent<render::MeshRenderer>(mesh, material);
  return part;
}

// Outlines in metres. A shape has coarse stand-ins for small pictures, in which it is a few pixels
// wide; they enclose the same area.
render::CoarserMesh coarser(std::span<const LathePoint> outline, int segments, int fine_segments,
                            float error_m, const std::string& name) {
  std::vector<LathePoint> points(outline.begin(), outline.end());
  const double factor = render::equalAreaRadius(segments, fine_segments);
  for (LathePoint& point : points) point.radius_m *= factor;
  return {render::lathe(points, segments, name), error_m};
}

MeshPtr turned(std::span<const LathePoint> outline, int segments, const std::string& name,
               std::vector<render::CoarserMesh> coarse) {
  render::Mesh mesh = *render::lathe(outline, segments, name);
  mesh.coarser = std::move(coarse);
  return render::share(std::move(mesh));
}

MeshPtr hammerHead() {
  static const std::array<LathePoint, 9> outline{{{0.0, -0.0486},
                                                  {0.0279, -0.0486},
                                                  {0.0300, -0.0462},
                                                  {0.0263, -0.0243},
                                                  {0.0244, 0.0},
                                                  {0.0263, 0.0243},
                                                  {0.0300, 0.0462},
                                                  {0.0279, 0.0486},
                                                  {0.0, 0.0486}}};
  static const std::array<LathePoint, 5> coarse{
      {{0.0, -0.0486}, {0.0295, -0.0480}, {0.0244, 0.0}, {0.0295, 0.0480}, {0.0, 0.0486}}};
  static const MeshPtr mesh = turned(outline, 12, "hammer head",
                                     {coarser(coarse, 12, 12, 0.0012F, "hammer head (12 segments)"),
                                      coarser(coarse, 8, 12, 0.0024F, "hammer head (8 segments)")});
  return mesh;
}

MeshPtr hammerHandle() {
  static const std::array<LathePoint, 10> outline{{{0.0, 0.0},
                                                   {0.0155, 0.0},
                                                   {0.0119, 0.013},
                                                   {0.0091, 0.030},
                                                   {0.0077, 0.057},
                                                   {0.0080, 0.070},
                                                   {0.0116, 0.163},
                                                   {0.0204, 0.169},
                                                   {0.0204, 0.1740},
                                                   {0.0, 0.1747}}};
  static const std::array<LathePoint, 7> middle{{{0.0, 0.0},
                                                 {0.0147, 0.0},
                                                 {0.0080, 0.040},
                                                 {0.0116, 0.163},
                                                 {0.0204, 0.1695},
                                                 {0.0204, 0.1740},
                                                 {0.0, 0.1747}}};
  static const std::array<LathePoint, 6> coarse{{{0.0, 0.0},
                                                 {0.0147, 0.0},
                                                 {0.0080, 0.040},
                                                 {0.0116, 0.163},
                                                 {0.0204, 0.172},
                                                 {0.0, 0.1747}}};
  static const MeshPtr mesh =
      turned(outline, 8, "hammer handle",
             {coarser(middle, 8, 8, 0.0013F, "hammer handle (8 segments)"),
              coarser(coarse, 6, 8, 0.0035F, "hammer handle (6 segments)")});
  return mesh;
}

// A grip around the y axis with the trigger in front of its upper end (+z). One mesh, so that it
// costs one draw call.
render::Mesh gripWithTrigger(std::span<const LathePoint> outline, int segments,
                             const std::string& name) {
  render::Mesh body = *render::lathe(outline, segments, name);
  const Eigen::AngleAxisf tilt(-0.58F, Eigen::Vector3f::UnitX());
  const Eigen::Vector3f center(0.0F, 0.0802F, 0.0197F);
  const Eigen::Vector3f size(0.018F, 0.037F, 0.022F);
  const auto first = static_cast<std::uint32_t>(body.vertices.size());
  const MeshPtr trigger = render::box();
  for (render::Vertex vertex : trigger->vertices) {
    vertex.position = center + tilt * vertex.position.cwiseProduct(size);
    vertex.normal = tilt * vertex.normal;
    body.vertices.push_back(vertex);
  }
  for (const std::uint32_t index : trigger->indices) body.indices.push_back(first + index);
  return body;
}

MeshPtr controllerBody() {
  static const std::array<LathePoint, 6> outline{{{0.0, -0.0185},
                                                  {0.0135, -0.0135},
                                                  {0.0190, 0.0},
                                                  {0.0205, 0.040},
                                                  {0.0090, 0.064},
                                                  {0.0, 0.068}}};
  static const std::array<LathePoint, 5> coarse{
      {{0.0, -0.0185}, {0.0182, -0.0080}, {0.0213, 0.040}, {0.0090, 0.065}, {0.0, 0.068}}};
  static const MeshPtr mesh = [] {
    render::Mesh body = gripWithTrigger(outline, 8, "controller body");
    body.coarser = {{render::share(gripWithTrigger(coarse, 6, "coarse controller body")), 0.0034F}};
    return render::share(std::move(body));
  }();
  return mesh;
}

MeshPtr controllerRing() {
  static const std::array<LathePoint, 2> outline{{{0.034, -0.012}, {0.034, 0.012}}};
  static const MeshPtr mesh =
      turned(outline, 12, "controller ring",
             {coarser(outline, 8, 12, 0.0022F, "controller ring (8 segments)")});
  return mesh;
}

// Without the side that faces the ground.
MeshPtr platformMesh() {
  static const std::array<LathePoint, 3> outline{{{0.45, -0.03}, {0.45, 0.03}, {0.0, 0.03}}};
  static const MeshPtr mesh = render::lathe(outline, 24, "platform");
  return mesh;
}

MeshPtr floorArrow() {
  static const std::array<Vec3, 3> points{Vec3(-0.2, 0.0, 0.0), Vec3(0.0, 0.0, 0.2),
                                          Vec3(0.2, 0.0, 0.0)};
  static const MeshPtr mesh = render::strip(points, 0.018, Vec3::UnitY(), "floor arrow");
  return mesh;
}

// Turns what was made around y.
Quat aroundAxis(const Vec3& axis) { return rotationBetween(Vec3::UnitY(), axis); }

render::DirectionalLight& addLight(scene::Scene& scene, const std::string& name, const Vec3& travel,
                                   float intensity) {
  scene::GameObject& object = scene.create(name);
  object.transform().setLocalRotation(lookAlong(travel));
  auto& light = object.addComponent<render::DirectionalLight>();
  light.intensity = intensity;
  return light;
}

void addSky(scene::Scene& scene) {
  auto& sky = scene.create("Sky").addComponent<render::Skybox>();
  sky.atmosphere_thickness = 1.75F;
  sky.exposure = 0.83F;
  sky.sky_tint = {0.132F, 0.132F, 0.132F, 1.0F};
  sky.ground = {0.962F, 0.962F, 0.962F, 1.0F};
}

void addFloor(scene::Scene& scene) {
  Material yellow;
  yellow.albedo = {1.0F, 0.994F, 0.401F, 1.0F};
  yellow.smoothness = 0.1F;
  scene::GameObject& platform = scene.create("Platform");
  platform.addComponent<render::MeshRenderer>(platformMesh(), yellow);

  scene::GameObject& arrow = scene.create("Floor Arrow");
  arrow.transform().setLocalPosition({0.0, 0.04, 0.2});
  arrow.addComponent<render::MeshRenderer>(floorArrow(),
                                           translucent({0.0F, 1.0F, 0.084F, 0.24F}, 0.5F));
}

render::Camera& addCamera(scene::Scene& scene, std::string_view name, const Pose& pose) {
  scene::GameObject& object = scene.create(std::string(name));
  object.transform().setPose(pose);
  return object.addComponent<render::Camera>();
}

void addCameras(scene::Scene& scene) {
  // The reference's recorder camera.
  render::Camera& recorder =
      addCamera(scene, rl::kThirdPersonCameraPath, {{0.0, 1.1, -0.1}, Quat::Identity()});
  recorder.vertical_fov_deg = 60.0;
  recorder.far_m = 3.0;
  // It stands where the player's head is.
  recorder.culling_mask = ~(1U << rl::kPlayerLooksLayer);
  // Ours, for people who watch; the round moves it to where the player stands.
  const Pose pose = spectatorPose({0.0, 1.17, 0.0}, xr::Hand::right);
  render::Camera& spectator = addCamera(scene, rl::kSpectatorCameraPath, pose);
  spectator.vertical_fov_deg = 50.0;
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

void addHammerLooks(scene::GameObject& hammer) {
  scene::GameObject& head = addPart(hammer, "Head", hammerHead(), wood(srgb8(89.0F, 48.0F, 14.0F)));
  head.transform().setLocalPosition({0.0, 1.396, 0.0});
  head.transform().setLocalRotation(
      Quat(Eigen::AngleAxisd(-std::numbers::pi / 2.0, Vec3::UnitZ())));
  head.transform().setLocalScale(1.0 / kMetresPerHammerUnit);
  scene::GameObject& handle =
      addPart(hammer, "Handle", hammerHandle(), wood(srgb8(61.0F, 28.0F, 8.0F)));
  handle.transform().setLocalScale(1.0 / kMetresPerHammerUnit);
}

// Simplified from the pictures of the original: a body along the hammer's handle, and the tracking
// ring, tilted, above the hand.
void addControllerLooks(scene::GameObject& controller, xr::Hand hand) {
  const double side = hand == xr::Hand::left ? -1.0 : 1.0;
  Material plastic = translucent({0.113F, 0.083F, 0.083F, 0.51F}, 0.6F);
  plastic.metallic = 0.5F;
  scene::GameObject& body = addPart(controller, "Body", controllerBody(), plastic);
  body.transform().setLocalPosition({side * 0.0096, -0.0479, -0.0555});
  body.transform().setLocalRotation(aroundAxis({side * 0.004690, 0.635087, 0.772427}));
  plastic.cull_back = false;
  scene::GameObject& ring = addPart(controller, "Ring", controllerRing(), plastic);
  ring.transform().setLocalPosition({side * 0.0096, 0.0352, -0.0085});
  ring.transform().setLocalRotation(aroundAxis({side * 0.278, 0.67, 0.68}));
}

void addAreaLooks(scene::GameObject& area, double edge_m) {
  scene::GameObject& sheet =
      addPart(area, "Sheet", render::box(), translucent({0.211F, 1.0F, 0.0F, 0.255F}, 0.0F));
  sheet.transform().setLocalScale({edge_m, edge_m, 0.001});
}

Pose spectatorPose(const Vec3& head_m, xr::Hand hand) {
  const double side = hand == xr::Hand::left ? -1.0 : 1.0;
  const Vec3 offset(side * 0.80, 0.22, -0.40);
  const Vec3 aim(side * 0.08, -0.05, 0.22);
  return {head_m + offset, lookAlong(aim - offset)};
}

void addRoomLooks(scene::Scene& scene, xr::Hand hand) {
  const double side = hand == xr::Hand::left ? -1.0 : 1.0;
  addLight(scene, "Sun", {side * -0.466, -0.363, 0.807}, 1.0F);
  // Half as strong in the original's editor, which means half in sRGB: 0.214 in linear light.
  addLight(scene, "Second Light", {side * -0.562, -0.595, 0.575}, render::linearFromSrgb(0.5F));
  addSky(scene);
  addFloor(scene);
  addCameras(scene);
}

}  // namespace sim2vr::games::whacamole

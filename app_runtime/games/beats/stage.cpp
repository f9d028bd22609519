// SPDX-License-Identifier: Apache-2.0
#include "beats/stage.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <utility>

#include "sim2vr/core/math.hpp"
#include "sim2vr/render/mesh.hpp"
#include "sim2vr/rl/room_looks.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::games::beats {
namespace {

// At 90 degrees the rails come into a picture of 3:2 in its lower corners (x / y = 3 / 2) and end
// two fifths of its height up.
constexpr double kRail_x_m = 1.2;
constexpr double kRail_y_m = -0.8;
constexpr double kRailWidth_m = 0.03;
constexpr double kRailFrom_m = -1.0;
constexpr double kRailTo_m = 5.0;

// From the origin. The third person's stands behind the player, the spectator's to the right.
const std::array<rl::OutsideView, 2>& views() {
  static const std::array<rl::OutsideView, 2> both{{
      {rl::kThirdPersonCameraPath, {0.0, 0.55, -1.7}, {0.0, -0.35, 1.5}, 60.0},
      {rl::kSpectatorCameraPath, {1.9, 0.55, -1.3}, {-0.1, -0.35, 1.0}, 55.0},
  }};
  return both;
}

/// Adds two rails below an object that is to be put at the round's origin, cameras, and a light for
/// what is not the game's own (the headset in pictures from outside). Returns that object.
scene::GameObject& addRoomLooks(scene::Scene& scene) {
  scene::GameObject& lane = scene.create("Lane");
  for (const double side : {-1.0, 1.0}) {
    scene::GameObject& rail = scene.create(side < 0.0 ? "Left Rail" : "Right Rail", &lane);
    rail.addComponent<render::MeshRenderer>(render::box(), render::unlitMaterial(kRail));
    rail.transform().setLocalPosition(
        {side * kRail_x_m, kRail_y_m, (kRailFrom_m + kRailTo_m) / 2.0});
    rail.transform().setLocalScale({kRailWidth_m, kRailWidth_m, kRailTo_m - kRailFrom_m});
  }
  for (const rl::OutsideView& view : views()) rl::addCamera(scene, view).far_m = 20.0;
  rl::addLight(scene, {-0.4, -0.6, 0.7});
  return lane;
}

/// Puts rails and cameras to where the player stands.
void placeRoom(scene::GameObject& lane, const Vec3& origin_m) {
  lane.transform().setPosition(origin_m);
  for (const rl::OutsideView& view : views()) {
    lane.scene().find(view.path)->transform().setPose(view.from(origin_m));
  }
}

/// A cube of edge 1 as a frame of bars; on the side that faces the player (-z) a filled triangle
/// that points down, or a disc for boxes of any direction.
render::MeshPtr arrowBox();
render::MeshPtr dotBox();
/// A star of eight spikes that reach 1 from the middle: two tetrahedra.
render::MeshPtr star();
/// A cube of edge 1 whose sides are stripes, half of each open.
render::MeshPtr stripedBlock();

using Vec3f = Eigen::Vector3f;
using render::Mesh;
using render::MeshPtr;

// Shares of the edge.
constexpr float kBar = 0.07F;
constexpr float kDotRadius = 0.22F;
// In front of the bars, so that neither hides the other.
constexpr float kMark_z = -0.5F - kBar / 4.0F;
constexpr int kStripes = 4;

void addTriangle(Mesh& mesh, const std::array<Vec3f, 3>& corners) {
  const Vec3f normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized();
  for (const Vec3f& corner : corners) {
    mesh.indices.push_back(static_cast<std::uint32_t>(mesh.vertices.size()));
    mesh.vertices.push_back({corner, normal});
  }
}

// A bar along `axis` as long as the edge, without its ends.
void addBar(Mesh& mesh, int axis, const Vec3f& center) {
  Vec3f size = Vec3f::Constant(kBar);
  size[axis] = 1.0F;
  const MeshPtr unit = render::box();
  for (std::size_t i = 0; i < unit->indices.size(); i += 3) {
    std::array<Vec3f, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) {
      corners.at(k) = center + unit->vertices[unit->indices[i + k]].position.cwiseProduct(size);
    }
    if (std::abs(unit->vertices[unit->indices[i]].normal[axis]) < 0.5F) addTriangle(mesh, corners);
  }
}

Mesh frame(const std::string& name) {
  // Inside the unit cube, which is what is cut.
  constexpr float kMiddle = 0.5F - kBar / 2.0F;
  Mesh mesh;
  mesh.name = name;
  for (int axis = 0; axis < 3; ++axis) {
    for (const float u : {-kMiddle, kMiddle}) {
      for (const float v : {-kMiddle, kMiddle}) {
        Vec3f center = Vec3f::Zero();
        center[(axis + 1) % 3] = u;
        center[(axis + 2) % 3] = v;
        addBar(mesh, axis, center);
      }
    }
  }
  return mesh;
}

MeshPtr arrowBox() {
  static const MeshPtr mesh = [] {
    Mesh box = frame("arrow box");
    addTriangle(box, {Vec3f(-0.38F, 0.38F, kMark_z), Vec3f(0.38F, 0.38F, kMark_z),
                      Vec3f(0.0F, -0.28F, kMark_z)});
    return render::share(std::move(box));
  }();
  return mesh;
}

MeshPtr dotBox() {
  static const MeshPtr mesh = [] {
    Mesh box = frame("dot box");
    const MeshPtr disc = render::disc(8);
    const auto first = static_cast<std::uint32_t>(box.vertices.size());
    for (render::Vertex vertex : disc->vertices) {
      vertex.position = vertex.position * kDotRadius + Vec3f(0.0F, 0.0F, kMark_z);
      box.vertices.push_back(vertex);
    }
    for (const std::uint32_t index : disc->indices) box.indices.push_back(first + index);
    return render::share(std::move(box));
  }();
  return mesh;
}

MeshPtr star() {
  static const MeshPtr mesh = [] {
    const auto side = std::numbers::inv_sqrt3_v<float>;
    Mesh spikes;
    spikes.name = "mine";
    for (const float sign : {-1.0F, 1.0F}) {
      const std::array<Vec3f, 4> corners{Vec3f(1.0F, 1.0F, 1.0F), Vec3f(1.0F, -1.0F, -1.0F),
                                         Vec3f(-1.0F, 1.0F, -1.0F), Vec3f(-1.0F, -1.0F, 1.0F)};
      for (std::size_t left_out = 0; left_out < 4; ++left_out) {
        std::array<Vec3f, 3> face;
        for (std::size_t k = 0; k < 3; ++k) {
          face.at(k) = sign * side * corners.at((left_out + 1 + k) % 4);
        }
        const Vec3f middle = face[0] + face[1] + face[2];
        if ((face[1] - face[0]).cross(face[2] - face[0]).dot(middle) < 0.0F) {
          std::swap(face[1], face[2]);
        }
        addTriangle(spikes, face);
      }
    }
    return render::share(std::move(spikes));
  }();
  return mesh;
}

MeshPtr stripedBlock() {
  static const MeshPtr mesh = [] {
    Mesh block;
    block.name = "wall";
    // Along `along`, one above the other along `across`, on both sides of the block.
    const auto addStripes = [&block](int along, int across) {
      const int out = 3 - along - across;
      for (const float side : {-0.5F, 0.5F}) {
        for (int i = 0; i < kStripes; ++i) {
          const float low = (static_cast<float>(i) + 0.25F) / kStripes - 0.5F;
          std::array<Vec3f, 4> corners;
          for (std::size_t k = 0; k < 4; ++k) {
            Vec3f& corner = corners.at(k);
            corner[out] = side;
            corner[along] = k == 1 || k == 2 ? 0.5F : -0.5F;
            corner[across] = k >= 2 ? low + 0.5F / kStripes : low;
          }
          addTriangle(block, {corners[0], corners[1], corners[2]});
          addTriangle(block, {corners[0], corners[2], corners[3]});
        }
      }
    };
    addStripes(0, 1);  // front and back
    addStripes(2, 1);  // left and right
    addStripes(2, 0);  // top and bottom
    return render::share(std::move(block));
  }();
  return mesh;
}

constexpr int kSparks = 16;
constexpr double kSparkSpeed_mps = 1.6;
constexpr double kSparkSize_m = 0.05;

// Most intervals [times - before, ends] that are open at once; `times` is in order.
std::size_t mostAtOnce(const std::vector<double>& times, std::vector<double> ends,
                       double before_s) {
  std::sort(ends.begin(), ends.end());
  std::size_t most = 0, ended = 0;
  for (std::size_t i = 0; i < times.size(); ++i) {
    while (ended < ends.size() && ends[ended] < times[i] - before_s) ++ended;
    most = std::max(most, i + 1 - ended);
  }
  return most;
}

template <class T, class End>
std::size_t mostOut(const std::vector<T>& things, double before_s, const End& end_of) {
  std::vector<double> times, ends;
  for (const T& thing : things) {
    times.push_back(thing.time_s);
    ends.push_back(end_of(thing));
  }
  return mostAtOnce(times, ends, before_s);
}

render::MeshRenderer& addHidden(scene::Scene& scene, const std::string& name,
                                const render::MeshPtr& mesh, const render::Material& material) {
  auto& renderer = scene.create(name).addComponent<render::MeshRenderer>(mesh, material);
  renderer.visible = false;
  return renderer;
}

void place(render::MeshRenderer& looks, const Block& block, const Vec3& size_m) {
  looks.visible = true;
  scene::Transform& transform = looks.transform();
  transform.setLocalPosition(block.center_m);
  transform.setLocalRotation(Quat(Eigen::AngleAxisd(block.turn_rad, Vec3::UnitZ())));
  transform.setLocalScale(size_m);
}

// Evenly spread over the sphere; no random numbers, so that looks cannot change a round.
Vec3 sparkDirection(int i) {
  const double height = (2.0 * i + 1.0) / kSparks - 1.0;
  const double angle = i * std::numbers::pi * (3.0 - std::sqrt(5.0));
  const double radius = std::sqrt(1.0 - height * height);
  return {radius * std::cos(angle), radius * std::sin(angle), height};
}

}  // namespace

void Stage::Awake() {
  const Level& level = round_.level();
  const auto passing = [this, &level](const auto& thing) {
    return passTime_s(round_.layout(), level, thing.time_s);
  };
  const auto going = [&level](const Wall& wall) { return goneTime_s(level, wall); };
  lane_ = &addRoomLooks(scene());
  for (std::size_t i = mostOut(level.boxes, level.approach_s, passing); i > 0; --i) {
    boxes_.push_back({&addHidden(scene(), "Box", arrowBox(), render::unlitMaterial(kRed)),
                      &addHidden(scene(), "Dot Box", dotBox(), render::unlitMaterial(kRed))});
  }
  for (std::size_t i = mostOut(level.mines, level.approach_s, passing); i > 0; --i) {
    mines_.push_back(&addHidden(scene(), "Mine", star(), render::unlitMaterial(kMineColor)));
  }
  render::Material wall = render::unlitMaterial(kWallColor);
  wall.cull_back = false;
  for (std::size_t i = mostOut(level.walls, level.approach_s, going); i > 0; --i) {
    walls_.push_back(&addHidden(scene(), "Wall", stripedBlock(), wall));
  }
  const std::array<render::Color, 3> colors{kRed, kCyan, kMineColor};
  for (std::size_t i = 0; i < sparks_.size(); ++i) {
    sparks_.at(i) = &scene().create("Sparks").addComponent<render::Billboards>();
    sparks_.at(i)->color = colors.at(i);
  }
}

void Stage::LateUpdate() {
  placeRoom(*lane_, round_.origin_m());
  showBoxes();
  showMines();
  showWalls();
  showBursts();
}

void Stage::showBoxes() {
  const std::vector<std::size_t> out = round_.boxesOut();
  for (std::size_t k = 0; k < boxes_.size(); ++k) {
    BoxLooks& looks = boxes_[k];
    looks.arrow->visible = looks.dot->visible = false;
    if (k >= out.size()) continue;
    const Box& box = round_.level().boxes[out[k]];
    render::MeshRenderer& shown = box.cut == CutDirection::kAny ? *looks.dot : *looks.arrow;
    shown.material.albedo = colorOf(box.hand);
    const Block block = round_.box(out[k]);
    place(shown, block, 2.0 * block.half_m);
  }
}

void Stage::showMines() {
  const std::vector<std::size_t> out = round_.minesOut();
  for (std::size_t k = 0; k < mines_.size(); ++k) {
    mines_[k]->visible = false;
    if (k >= out.size()) continue;
    place(*mines_[k], round_.mine(out[k]), Vec3::Constant(round_.layout().mine_radius_m));
  }
}

void Stage::showWalls() {
  const std::vector<std::size_t> out = round_.wallsOut();
  for (std::size_t k = 0; k < walls_.size(); ++k) {
    walls_[k]->visible = false;
    if (k >= out.size()) continue;
    const Block wall = round_.wall(out[k]);
    place(*walls_[k], wall, 2.0 * wall.half_m);
  }
}

void Stage::showBursts() {
  for (render::Billboards* sparks : sparks_) sparks->billboards.clear();
  for (const Round::Burst& burst : round_.bursts()) {
    auto& billboards = sparks_.at(static_cast<std::size_t>(burst.of))->billboards;
    const double age_s = round_.time_s() - burst.time_s;
    const double size_m = kSparkSize_m * (1.0 - age_s / Round::kBurst_s);
    for (int i = 0; i < kSparks; ++i) {
      billboards.push_back({burst.place_m + kSparkSpeed_mps * age_s * sparkDirection(i), size_m});
    }
  }
}

}  // namespace sim2vr::games::beats

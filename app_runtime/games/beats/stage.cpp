#include "beats/stage.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "beats/colors.hpp"
#include "beats/room_looks.hpp"
#include "beats/shapes.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::games::beats {
namespace {

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
    mines_.push_back(&addHidden(scene(), "Mine", star(), render::unlitMaterial(kMine)));
  }
  render::Material wall = render::unlitMaterial(kWall);
  wall.cull_back = false;
  for (std::size_t i = mostOut(level.walls, level.approach_s, going); i > 0; --i) {
    walls_.push_back(&addHidden(scene(), "Wall", stripedBlock(), wall));
  }
  const std::array<render::Color, 3> colors{kRed, kCyan, kMine};
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

// SPDX-License-Identifier: Apache-2.0
#include "whacamole/privileged.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "sim2vr/physics/collider.hpp"
#include "sim2vr/rl/privileged_table.hpp"
#include "sim2vr/rl/view_frustum.hpp"
#include "sim2vr/scene/scene.hpp"
#include "whacamole/hammer.hpp"

namespace sim2vr::games::whacamole {
namespace {

bool hasEnded(const Target& target) { return target.state() == Target::State::kFadeOut; }

const Target* firstAlive(const std::vector<const Target*>& targets) {
  const auto found = std::find_if(targets.begin(), targets.end(), [](const Target* target) {
    return target->state() == Target::State::kAlive;
  });
  return found == targets.end() ? nullptr : *found;
}

const Target* nearest(const std::vector<const Target*>& targets, const Vec3& point_m) {
  const auto distance = [&point_m](const Target* target) {
    return (target->hitCenter_m() - point_m).squaredNorm();
  };
  const auto found = std::min_element(
      targets.begin(), targets.end(),
      [&distance](const Target* a, const Target* b) { return distance(a) < distance(b); });
  return found == targets.end() ? nullptr : *found;
}

// What the table's getters read. Of targets only those that the head camera has shown, null where
// there is none.
struct Source {
  const Round& round;
  const Hammer& hammer;
  Vec3 marker_m;
  Vec3 marker_velocity_mps;
  Vec3 head_m;
  const scene::Transform& area;
  double now_s;
  std::array<const Target*, kCells> cells{};
  std::array<const Target*, Privileged::kNext> next{};
  const Target* nearest = nullptr;
  double progress_m;
  double strike;
  double start_distance_m = std::numeric_limits<double>::infinity();
  int start_cell = 0;
};

using Table = rl::PrivilegedTable<Source>;

void addTarget(Table& table, const std::string& name,
               const std::function<const Target*(const Source&)>& target) {
  table.number(name + "present", [=](const Source& s) { return target(s) != nullptr; });
  table.number(name + "alive", [=](const Source& s) {
    return target(s) != nullptr && target(s)->state() == Target::State::kAlive;
  });
  table.number(name + "overlap", [=](const Source& s) {
    return target(s) != nullptr &&
           physics::overlaps(*s.hammer.gameObject().getComponent<physics::Collider>(),
                             *target(s)->gameObject().getComponent<physics::Collider>());
  });
  table.number(name + "life_s", [=](const Source& s) {
    return target(s) == nullptr ? 0.0 : target(s)->expiry_s() - s.now_s;
  });
  table.vector(name, "_m", [=](const Source& s) {
    return target(s) == nullptr ? Vec3(Vec3::Zero()) : Vec3(target(s)->hitCenter_m() - s.marker_m);
  });
}

Table makeTable() {
  Table table;
  constexpr std::array kPlacements{std::pair{"round.low", Placement::kLow},
                                   std::pair{"round.mid", Placement::kMid},
                                   std::pair{"round.high", Placement::kHigh}};
  for (const auto& [name, placement] : kPlacements) {
    table.number(name, [placement = placement](const Source& s) {
      return s.round.condition().placement == placement;
    });
  }
  table.number("round.constrained",
               [](const Source& s) { return s.round.condition().constrained; });
  table.number("round.max_targets",
               [](const Source& s) { return s.round.condition().max_targets; });
  table.number("round.strike_threshold_mps", [](const Source& s) {
    return s.round.condition().constrained ? s.round.settings().strike_threshold_mps : 0.0;
  });
  table.number("round.elapsed_s", [](const Source& s) { return s.round.elapsed_s(); });
  const auto rotation = [](const Source& s) { return s.hammer.transform().rotation(); };
  table.vector("hammer.", "_m", [](const Source& s) -> Vec3 { return s.marker_m - s.head_m; });
  table.vector("hammer.v", "_mps", [](const Source& s) { return s.marker_velocity_mps; });
  table.vector("hammer.root_v", "_mps", [](const Source& s) { return s.hammer.velocity_mps(); });
  table.vector("hammer.face_", "",
               [=](const Source& s) -> Vec3 { return rotation(s) * -Vec3::UnitX(); });
  table.vector("hammer.handle_", "",
               [=](const Source& s) -> Vec3 { return rotation(s) * Vec3::UnitY(); });
  table.number("hammer.strike_mps",
               [](const Source& s) { return s.round.strikeSpeed_mps(s.hammer.velocity_mps()); });
  table.number("hammer.depth_m", [](const Source& s) {
    return (s.marker_m - s.area.position()).dot(s.area.forward());
  });
  for (std::size_t i = 0; i < kCells; ++i) {
    addTarget(table, "cell" + std::to_string(i) + ".", [i](const Source& s) { return s.cells[i]; });
  }
  for (std::size_t i = 0; i < Privileged::kNext; ++i) {
    addTarget(table, "next" + std::to_string(i) + ".", [i](const Source& s) { return s.next[i]; });
  }
  addTarget(table, "nearest.", [](const Source& s) { return s.nearest; });
  table.number("aid.progress_m", [](const Source& s) { return s.progress_m; });
  table.number("aid.strike", [](const Source& s) { return s.strike; });
  table.number("aid.start_distance_m", [](const Source& s) { return s.start_distance_m; });
  table.number("aid.start_cell", [](const Source& s) { return s.start_cell; });
  table.vector("aid.home_", "_m", [](const Source& s) -> Vec3 {
    return s.area.transformPoint(Vec3(0.0, 0.0, -Privileged::kStrokeStart_m)) - s.marker_m;
  });
  return table;
}

const Table& table() {
  static const Table table = makeTable();
  return table;
}

}  // namespace

const std::vector<std::string>& Privileged::names() { return table().names(); }

void Privileged::look() {
  const auto& camera = *camera_->getComponent<render::Camera>();
  camera_->scene().forEach<Target>([&](const Target& target) {
    int& seen_id = seen_ids_[static_cast<std::size_t>(target.cell())];
    if (seen_id == target.id() || hasEnded(target)) return;
    if (rl::inView(camera, aspect_, target.hitCenter_m())) seen_id = target.id();
  });
  addToAids();
}

void Privileged::addToAids() {
  const Vec3 marker = round_->hammer().markerPosition();
  const double dt_s = camera_->scene().clock().deltaTime();
  if (has_marker_) {
    if (dt_s > 0.0) marker_velocity_mps_ = (marker - marker_m_) / dt_s;
    std::vector<const Target*> alive = shown();
    std::erase_if(alive, [](const Target* t) { return t->state() != Target::State::kAlive; });
    if (const Target* aim = firstAlive(alive)) {
      const Vec3 there = aim->hitCenter_m();
      progress_sum_m_ += (there - marker_m_).norm() - (there - marker).norm();
    }
    if (const Target* aim = nearest(alive, marker)) {
      const double speed_mps = round_->strikeSpeed_mps(round_->hammer().velocity_mps());
      const double reach = (aim->hitCenter_m() - marker).norm() / kStrikeReach_m;
      strike_sum_ += std::clamp(speed_mps, 0.0, 1.0) * std::exp(-reach * reach) * dt_s;
    }
  }
  marker_m_ = marker;
  has_marker_ = true;
}

std::vector<const Target*> Privileged::shown() const {
  std::vector<const Target*> targets;
  camera_->scene().forEach<Target>([&](const Target& target) {
    if (hasEnded(target)) return;
    if (seen_ids_[static_cast<std::size_t>(target.cell())] == target.id()) {
      targets.push_back(&target);
    }
  });
  std::sort(targets.begin(), targets.end(), [](const Target* a, const Target* b) {
    return a->expiry_s() == b->expiry_s() ? a->id() < b->id() : a->expiry_s() < b->expiry_s();
  });
  return targets;
}

void Privileged::fill(std::span<float> values) const {
  const Hammer& hammer = round_->hammer();
  Source source{.round = *round_,
                .hammer = hammer,
                .marker_m = hammer.markerPosition(),
                .marker_velocity_mps = marker_velocity_mps_,
                .head_m = camera_->transform().position(),
                .area = area_->transform(),
                .now_s = camera_->scene().clock().time(),
                .progress_m = progress_sum_m_,
                .strike = strike_sum_};
  // The targets of a finished round are about to vanish.
  if (round_->phase() != Round::Phase::kDone) {
    const std::vector<const Target*> targets = shown();
    for (const Target* target : targets) {
      const Target*& cell = source.cells[static_cast<std::size_t>(target->cell())];
      if (cell == nullptr) cell = target;
    }
    std::copy_n(targets.begin(), std::min(targets.size(), source.next.size()), source.next.begin());
    source.nearest = nearest(targets, source.marker_m);
  }
  for (int cell = 0; cell < kCells; ++cell) {
    const Vec3 center_m = cellCenter_m(cell, round_->settings());
    const Vec3 start_m = source.area.transformPoint(center_m - Vec3(0.0, 0.0, kStrokeStart_m));
    const double distance_m = (start_m - source.marker_m).norm();
    if (distance_m < source.start_distance_m) {
      source.start_distance_m = distance_m;
      source.start_cell = cell;
    }
  }
  table().fill(source, values);
}

void Privileged::fields(Archive& archive) {
  archive.field("seen_ids", seen_ids_, {-1.0, kCounts.high});
  archive.field("has_marker", has_marker_);
  archive.field("marker", marker_m_);
  archive.field("marker_velocity", marker_velocity_mps_);
  archive.field("progress_sum", progress_sum_m_, kQuantities);
  archive.field("strike_sum", strike_sum_, kQuantities);
}

}  // namespace sim2vr::games::whacamole

#include "whacamole/privileged.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/physics/collider.hpp"
#include "sim2vr/rl/view_frustum.hpp"
#include "sim2vr/scene/scene.hpp"
#include "whacamole/hammer.hpp"

namespace sim2vr::games::whacamole {
namespace {

const std::array<const char*, 3> kAxes{"x", "y", "z"};

void addVector(std::vector<std::string>& names, const std::string& name, const std::string& unit) {
  for (const char* axis : kAxes) names.push_back(name + axis + unit);
}

void addTarget(std::vector<std::string>& names, const std::string& name) {
  for (const char* number : {"present", "alive", "overlap", "life_s"}) {
    names.push_back(name + number);
  }
  addVector(names, name, "_m");
}

std::vector<std::string> allNames() {
  std::vector<std::string> names{"round.low",         "round.mid",
                                 "round.high",        "round.constrained",
                                 "round.max_targets", "round.strike_threshold_mps",
                                 "round.elapsed_s"};
  addVector(names, "hammer.", "_m");
  addVector(names, "hammer.v", "_mps");
  addVector(names, "hammer.root_v", "_mps");
  addVector(names, "hammer.face_", "");
  addVector(names, "hammer.handle_", "");
  names.emplace_back("hammer.strike_mps");
  names.emplace_back("hammer.depth_m");
  for (int cell = 0; cell < kCells; ++cell) {
    addTarget(names, "cell" + std::to_string(cell) + ".");
  }
  for (int i = 0; i < Privileged::kNext; ++i) addTarget(names, "next" + std::to_string(i) + ".");
  addTarget(names, "nearest.");
  for (const char* aid : {"progress_m", "strike", "start_distance_m", "start_cell"}) {
    names.push_back(std::string("aid.") + aid);
  }
  addVector(names, "aid.home_", "_m");
  return names;
}

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

}  // namespace

const std::vector<std::string>& Privileged::names() {
  static const std::vector<std::string> names = allNames();
  return names;
}

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
    std::vector<const Target*> alive = told();
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

std::vector<const Target*> Privileged::told() const {
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
  if (values.size() != names().size()) {
    throw InvalidArgument("values", std::to_string(values.size()) + " numbers",
                          std::to_string(names().size()));
  }
  rl::NumberWriter out(values);
  // The targets of a finished round are on their way out.
  const bool over = round_->phase() == Round::Phase::kDone;
  const std::vector<const Target*> targets = over ? std::vector<const Target*>() : told();
  writeRound(out);
  writeHammer(out);
  writeCells(out, targets);
  writeNext(out, targets);
  writeTarget(out, nearest(targets, round_->hammer().markerPosition()));
  writeAids(out);
}

void Privileged::writeRound(rl::NumberWriter& out) const {
  const Condition& condition = round_->condition();
  for (const Placement placement : {Placement::kLow, Placement::kMid, Placement::kHigh}) {
    out.flag(condition.placement == placement);
  }
  out.flag(condition.constrained);
  out.number(condition.max_targets);
  out.number(condition.constrained ? round_->settings().strike_threshold_mps : 0.0);
  out.number(round_->elapsed_s());
}

void Privileged::writeHammer(rl::NumberWriter& out) const {
  const Hammer& hammer = round_->hammer();
  const Quat rotation = hammer.transform().rotation();
  const Vec3 marker = hammer.markerPosition();
  const scene::Transform& area = area_->transform();
  out.vector(marker - camera_->transform().position());
  out.vector(marker_velocity_mps_);
  out.vector(hammer.velocity_mps());
  out.vector(rotation * -Vec3::UnitX());
  out.vector(rotation * Vec3::UnitY());
  out.number(round_->strikeSpeed_mps(hammer.velocity_mps()));
  out.number((marker - area.position()).dot(area.forward()));
}

void Privileged::writeCells(rl::NumberWriter& out, const std::vector<const Target*>& told) const {
  for (int cell = 0; cell < kCells; ++cell) {
    const auto found = std::find_if(
        told.begin(), told.end(), [cell](const Target* target) { return target->cell() == cell; });
    writeTarget(out, found == told.end() ? nullptr : *found);
  }
}

void Privileged::writeNext(rl::NumberWriter& out, const std::vector<const Target*>& told) const {
  for (std::size_t i = 0; i < kNext; ++i) writeTarget(out, i < told.size() ? told[i] : nullptr);
}

void Privileged::writeTarget(rl::NumberWriter& out, const Target* target) const {
  const bool present = target != nullptr;
  out.flag(present);
  if (!present) {
    for (int i = 0; i < 3; ++i) out.number(0.0);
    out.vector(Vec3::Zero());
    return;
  }
  const Hammer& hammer = round_->hammer();
  out.flag(target->state() == Target::State::kAlive);
  out.flag(physics::overlaps(*hammer.gameObject().getComponent<physics::Collider>(),
                             *target->gameObject().getComponent<physics::Collider>()));
  out.number(target->expiry_s() - camera_->scene().clock().time());
  out.vector(target->hitCenter_m() - hammer.markerPosition());
}

void Privileged::writeAids(rl::NumberWriter& out) const {
  out.number(progress_sum_m_);
  out.number(strike_sum_);
  double least_m = std::numeric_limits<double>::infinity();
  int start_cell = 0;
  const scene::Transform& area = area_->transform();
  for (int cell = 0; cell < kCells; ++cell) {
    const Vec3 start = area.transformPoint(cellCenter_m(cell, round_->settings()) - Vec3(0.0, 0.0, kStrokeStart_m));
    const double distance_m = (start - round_->hammer().markerPosition()).norm();
    if (distance_m < least_m) {
      least_m = distance_m;
      start_cell = cell;
    }
  }
  out.number(least_m);
  out.number(start_cell);
  out.vector(area.transformPoint(Vec3(0.0, 0.0, -kStrokeStart_m)) -
             round_->hammer().markerPosition());
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

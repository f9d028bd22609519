#include "pointing/privileged.hpp"

#include <algorithm>
#include <array>
#include <limits>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/rl/view_frustum.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::games::pointing {
namespace {

// Where the target is in the picture and how wide, in yes and no: thresholds on its centre's place
// from the circle's centre and on its width.
constexpr std::array kShownPlaces_m{-0.14, -0.10, -0.06, -0.02, 0.02, 0.06, 0.10, 0.14};
constexpr std::array kShownWidths_m{0.025, 0.0375};

std::vector<std::string> allNames() {
  std::vector<std::string> names{"round.side_m", "round.height_m", "round.depth_m",
                                 "round.progress"};
  const auto add = [&names](const std::string& name, const std::string& unit) {
    for (const char* axis : {"x", "y", "z"}) names.push_back(name + axis + unit);
  };
  add("tip.", "_m");
  add("tip.v", "_mps");
  names.emplace_back("tip.depth_m");
  names.emplace_back("tip.armed");
  for (const char* number : {"present", "start", "width_m", "age_s"}) {
    names.push_back(std::string("target.") + number);
  }
  add("target.", "_m");
  add("target.place_", "_m");
  names.emplace_back("next.present");
  add("next.place_", "_m");
  for (const char* axis : {"x", "y"}) {
    for (std::size_t i = 0; i < kShownPlaces_m.size(); ++i) {
      names.push_back("shown." + std::string(axis) + std::to_string(i));
    }
  }
  for (std::size_t i = 0; i < kShownWidths_m.size(); ++i) {
    names.push_back("shown.width" + std::to_string(i));
  }
  names.emplace_back("aid.start_distance_m");
  names.emplace_back("aid.start_cell");
  return names;
}

}  // namespace

const std::vector<std::string>& Privileged::names() {
  static const std::vector<std::string> names = allNames();
  return names;
}

void Privileged::look() {
  if (round_->phase() != Round::Phase::kPlay) return;
  const auto& camera = *camera_->getComponent<render::Camera>();
  if (rl::inView(camera, aspect_, round_->targetCenter(round_->target()))) {
    seen_id_ = round_->targetId();
  }
}

bool Privileged::seen() const {
  return round_->phase() == Round::Phase::kPlay && seen_id_ == round_->targetId();
}

double Privileged::startDistance_m() const {
  const Settings& settings = round_->settings();
  const Vec3 tip_m = round_->stylus().tip_m() - round_->center_m();
  double least_m = std::numeric_limits<double>::infinity();
  for (const double distance_m : settings.distances_m) {
    for (int target = 0; target < settings.targets; ++target) {
      const Vec3 start_m =
          targetCenter_m(target, settings.targets, distance_m) - Vec3(0.0, 0.0, kTapStart_m);
      least_m = std::min(least_m, (start_m - tip_m).norm());
    }
  }
  return least_m;
}

void Privileged::fill(std::span<float> values) const {
  if (values.size() != names().size()) {
    throw InvalidArgument("values", std::to_string(values.size()) + " numbers",
                          std::to_string(names().size()));
  }
  rl::NumberWriter out(values);
  const Stylus& stylus = round_->stylus();
  const Vec3& tip_m = stylus.tip_m();
  const Vec3 head_m = camera_->transform().position();
  out.vector(round_->settings().center_m());
  out.number(round_->progress());
  out.vector(tip_m - head_m);
  out.vector(stylus.velocity_mps());
  out.number(tip_m.z() - round_->center_m().z());
  out.flag(stylus.armed());

  const bool present = seen();
  out.flag(present);
  out.flag(present && round_->trial() == 0);
  out.number(present ? round_->block().width_m : 0.0);
  out.number(present ? round_->age_s() : 0.0);
  const Vec3 target_m = round_->targetCenter(round_->target());
  out.vector(present ? Vec3(target_m - tip_m) : Vec3(Vec3::Zero()));
  out.vector(present ? Vec3(target_m - head_m) : Vec3(Vec3::Zero()));
  const auto next = present ? round_->nextTarget() : std::nullopt;
  out.flag(next.has_value());
  out.vector(next ? Vec3(round_->targetCenter(*next) - head_m) : Vec3(Vec3::Zero()));
  writeShown(out, present);
  out.number(startDistance_m());
  out.number(0.0);
}

void Privileged::writeShown(rl::NumberWriter& out, bool present) const {
  const Vec3 place_m = round_->targetCenter(round_->target()) - round_->center_m();
  for (const double along_m : {place_m.x(), place_m.y()}) {
    for (const double least_m : kShownPlaces_m) out.flag(present && along_m > least_m);
  }
  for (const double least_m : kShownWidths_m) {
    out.flag(present && round_->block().width_m > least_m);
  }
}

void Privileged::fields(Archive& archive) {
  archive.field("seen_id", seen_id_, {-1.0, kCounts.high});
}

}  // namespace sim2vr::games::pointing

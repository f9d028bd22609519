// SPDX-License-Identifier: Apache-2.0
#include "pointing/privileged.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <optional>

#include "sim2vr/rl/privileged_table.hpp"
#include "sim2vr/rl/view_frustum.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::games::pointing {
namespace {

// Where the target is in the picture and how wide, in yes and no: thresholds on its centre's place
// from the circle's centre and on its width.
constexpr std::array kShownPlaces_m{-0.14, -0.10, -0.06, -0.02, 0.02, 0.06, 0.10, 0.14};
constexpr std::array kShownWidths_m{0.025, 0.0375};

// What the table's getters read.
struct Source {
  const Round& round;
  Vec3 head_m;
  bool present;  // the target, and in view
  double start_distance_m;

  Vec3 target_m() const { return round.targetCenter(round.target()); }
  std::optional<int> next() const { return present ? round.nextTarget() : std::nullopt; }
};

rl::PrivilegedTable<Source> makeTable() {
  rl::PrivilegedTable<Source> table;
  const auto tip_m = [](const Source& s) { return s.round.stylus().tip_m(); };
  constexpr std::array kCenters{"round.side_m", "round.height_m", "round.depth_m"};
  for (int axis = 0; axis < 3; ++axis) {
    table.number(kCenters[axis],
                 [axis](const Source& s) { return s.round.settings().center_m()[axis]; });
  }
  table.number("round.progress", [](const Source& s) { return s.round.progress(); });
  table.vector("tip.", "_m", [=](const Source& s) -> Vec3 { return tip_m(s) - s.head_m; });
  table.vector("tip.v", "_mps", [](const Source& s) { return s.round.stylus().velocity_mps(); });
  table.number("tip.depth_m",
               [=](const Source& s) { return tip_m(s).z() - s.round.center_m().z(); });
  table.number("tip.armed", [](const Source& s) { return s.round.stylus().armed(); });

  table.number("target.present", [](const Source& s) { return s.present; });
  table.number("target.start", [](const Source& s) { return s.present && s.round.trial() == 0; });
  table.number("target.width_m",
               [](const Source& s) { return s.present ? s.round.block().width_m : 0.0; });
  table.number("target.age_s", [](const Source& s) { return s.present ? s.round.age_s() : 0.0; });
  table.vector("target.", "_m", [=](const Source& s) {
    return s.present ? Vec3(s.target_m() - tip_m(s)) : Vec3(Vec3::Zero());
  });
  table.vector("target.place_", "_m", [](const Source& s) {
    return s.present ? Vec3(s.target_m() - s.head_m) : Vec3(Vec3::Zero());
  });
  table.number("next.present", [](const Source& s) { return s.next().has_value(); });
  table.vector("next.place_", "_m", [](const Source& s) {
    const auto next = s.next();
    return next ? Vec3(s.round.targetCenter(*next) - s.head_m) : Vec3(Vec3::Zero());
  });
  for (int axis = 0; axis < 2; ++axis) {
    for (std::size_t i = 0; i < kShownPlaces_m.size(); ++i) {
      table.number(std::string("shown.") + "xy"[axis] + std::to_string(i),
                   [axis, least_m = kShownPlaces_m[i]](const Source& s) {
                     const Vec3 place_m = s.target_m() - s.round.center_m();
                     return s.present && place_m[axis] > least_m;
                   });
    }
  }
  for (std::size_t i = 0; i < kShownWidths_m.size(); ++i) {
    table.number("shown.width" + std::to_string(i), [least_m = kShownWidths_m[i]](const Source& s) {
      return s.present && s.round.block().width_m > least_m;
    });
  }
  table.number("aid.start_distance_m", [](const Source& s) { return s.start_distance_m; });
  table.number("aid.start_cell", [](const Source&) { return 0.0; });
  return table;
}

const rl::PrivilegedTable<Source>& table() {
  static const auto table = makeTable();
  return table;
}

}  // namespace

const std::vector<std::string>& Privileged::names() { return table().names(); }

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
  const Vec3 head_m = camera_->transform().position();
  table().fill({*round_, head_m, seen(), startDistance_m()}, values);
}

void Privileged::fields(Archive& archive) {
  archive.field("seen_id", seen_id_, {-1.0, kCounts.high});
}

}  // namespace sim2vr::games::pointing

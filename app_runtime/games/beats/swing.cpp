// SPDX-License-Identifier: Apache-2.0
#include "beats/swing.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr double kBeforePoints = 70.0;
constexpr double kAfterPoints = 30.0;
constexpr double kCentrePoints = 15.0;
// Between the planes of a step and of the cut.
constexpr double kFull_deg = 75.0;
constexpr double kNothing_deg = 90.0;

double angleBetween_deg(const Vec3& a, const Vec3& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180.0 / std::numbers::pi;
}

Vec3 along(const Segment& blade) { return blade.tip_m - blade.root_m; }

int share(double points, double of) {
  return static_cast<int>(std::lround(points * std::clamp(of, 0.0, 1.0)));
}

}  // namespace

int swingPoints(double before, double after, double centre_m) {
  return share(kBeforePoints, before) + share(kAfterPoints, after) +
         share(kCentrePoints, 1.0 - centre_m / kCentre_m);
}

double countedAngle_deg(double angle_deg, double between_planes_deg) {
  const double off = (between_planes_deg - kFull_deg) / (kNothing_deg - kFull_deg);
  return angle_deg * (1.0 - std::clamp(off, 0.0, 1.0));
}

void SwingStep::fields(Archive& archive) {
  archive.field("time_s", time_s, kQuantities);
  archive.field("root", blade.root_m);
  archive.field("tip", blade.tip_m);
  archive.field("normal", normal);
  archive.field("angle_deg", angle_deg, {0.0, 180.0});
}

void Swing::add(double time_s, const Segment& blade) {
  SwingStep step{time_s, blade};
  if (!steps_.empty()) {
    const Segment& before = steps_.back().blade;
    const Vec3 middle_m = (before.root_m + before.tip_m) / 2.0;
    step.normal = along(blade).cross(middle_m - blade.root_m).normalized();
    step.angle_deg = angleBetween_deg(along(before), along(blade));
  }
  // The step in which the time is up counts, too, and a step is from one frame to the next.
  const auto too_old = [&](const SwingStep& old) { return time_s - old.time_s > kSwing_s; };
  while (steps_.size() > 2 && too_old(steps_[1])) steps_.erase(steps_.begin());
  steps_.push_back(step);
}

double Swing::before(std::optional<double> angle_deg) const {
  double sum_deg = 0.0;
  for (std::size_t i = steps_.size(); i-- > 1;) {
    const double between_deg = angleBetween_deg(steps_[i].normal, now().normal);
    if (between_deg > kNothing_deg) break;
    const bool latest = i + 1 == steps_.size();
    sum_deg +=
        countedAngle_deg(latest && angle_deg ? *angle_deg : steps_[i].angle_deg, between_deg);
  }
  return sum_deg / kSwingBefore_deg;
}

OpenCut OpenCut::of(const Swing& swing, const Vec3& center_m) {
  OpenCut cut;
  cut.time_s = swing.now().time_s;
  cut.normal = swing.now().normal;
  cut.center_m = center_m;
  cut.centre_distance_m = std::abs(cut.normal.dot(center_m - swing.now().blade.root_m));
  cut.before = swing.before();
  return cut;
}

bool OpenCut::follow(const Swing& swing) {
  const SwingStep &now = swing.now(), &last = swing.last();
  if (now.time_s - time_s > kSwing_s) return true;
  if (halved) {
    const double between_deg = angleBetween_deg(now.normal, normal);
    if (between_deg > kNothing_deg) return true;
    after += countedAngle_deg(now.angle_deg, between_deg) / kSwingAfter_deg;
    return after >= 1.0;
  }
  // Along the cut and across the lane: the plane holds z, so that the box stays in it.
  const Vec3 across = normal.cross(Vec3::UnitZ());
  const double from_m = across.dot(last.blade.tip_m - center_m);
  const double to_m = across.dot(now.blade.tip_m - center_m);
  if (from_m * to_m > 0.0 || from_m == to_m) return false;
  halved = true;
  time_s = now.time_s;
  const double part = from_m / (from_m - to_m);
  const Vec3 blade = along(last.blade) + part * (along(now.blade) - along(last.blade));
  before = swing.before(angleBetween_deg(blade, along(last.blade)));
  after = angleBetween_deg(blade, along(now.blade)) / kSwingAfter_deg;
  return after >= 1.0;
}

void OpenCut::fields(Archive& archive) {
  archive.field("box", box);
  archive.field("hand", hand, Hand::kRight);
  archive.field("factor", factor, kCounts);
  archive.field("time_s", time_s, kQuantities);
  archive.field("normal", normal);
  archive.field("center", center_m);
  archive.field("centre_distance", centre_distance_m, kQuantities);
  archive.field("before", before, kQuantities);
  archive.field("after", after, kQuantities);
  archive.field("halved", halved);
  if (hand > Hand::kRight) throw EngineError("saved state: a hand that is none");
}

}  // namespace sim2vr::games::beats

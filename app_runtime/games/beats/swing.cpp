// SPDX-License-Identifier: Apache-2.0
#include "beats/swing.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr int kHighestTier = 3;
// Slower than this across the face is no direction.
constexpr double kStill_mps = 0.01;

// World axis times angle of the short way from one rotation to the other.
Vec3 turnBetween(const Quat& from, const Quat& to) {
  Quat turn = to * from.conjugate();
  if (turn.w() < 0.0) turn.coeffs() = -turn.coeffs();
  const double sine = turn.vec().norm();
  // Where nothing turns the axis is any.
  if (sine < 1e-12) return Vec3::Zero();
  return turn.vec() * (2.0 * std::atan2(sine, turn.w()) / sine);
}

Quat rotationOf(const Vec3& turn_rad) {
  const double angle = turn_rad.norm();
  if (angle < 1e-12) return Quat::Identity();
  return Quat(Eigen::AngleAxisd(angle, turn_rad / angle));
}

// World to the block's own axes.
Vec3 toBlock(const Block& block, const Vec3& point_m) {
  const Vec3 offset = point_m - block.center_m;
  const double c = std::cos(block.turn_rad), s = std::sin(block.turn_rad);
  return {c * offset.x() + s * offset.y(), c * offset.y() - s * offset.x(), offset.z()};
}

// How far outside [-half, half], with the side's sign.
double excess(double value, double half) {
  if (value > half) return value - half;
  if (value < -half) return value + half;
  return 0.0;
}

Vec3 excessOf(const Vec3& point, const Vec3& half) {
  return {excess(point.x(), half.x()), excess(point.y(), half.y()), excess(point.z(), half.z())};
}

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

std::optional<double> cutAngle_deg(const Box& box, const Vec3& velocity_mps) {
  if (box.cut == CutDirection::kAny) return 0.0;
  const double x = velocity_mps.x(), y = velocity_mps.y();
  if (std::hypot(x, y) < kStill_mps) return std::nullopt;
  const Eigen::Vector2d wanted = cutVector(box);
  const double sine = wanted.x() * y - wanted.y() * x;
  const double cosine = wanted.x() * x + wanted.y() * y;
  return std::abs(std::atan2(sine, cosine)) * 180.0 / std::numbers::pi;
}

int cutPoints(const ScoreRules& rules, double speed_mps, double angle_deg) {
  const double speed_share = std::clamp(
      (speed_mps - rules.min_speed_mps) / (rules.full_speed_mps - rules.min_speed_mps), 0.0, 1.0);
  const double angle_share = std::clamp(1.0 - angle_deg / rules.angle_limit_deg, 0.0, 1.0);
  return static_cast<int>(
      std::lround(kLeastPoints + kSpeedPoints * speed_share + kAnglePoints * angle_share));
}

// 2 slices to the second tier, 4 more to the third, 8 more to the last.
void Multiplier::addSlice() {
  if (tier_ == kHighestTier) return;
  if (++slices_ < 2 << tier_) return;
  ++tier_;
  slices_ = 0;
}

void Multiplier::addFault() {
  tier_ = std::max(0, tier_ - 1);
  slices_ = 0;
}

void Multiplier::fields(Archive& archive) {
  archive.field("tier", tier_, {0.0, kHighestTier});
  archive.field("slices", slices_, kCounts);
}

void Saber::follow(double dt_s) {
  const bool was_held = held_;
  held_ = controller_->activeInHierarchy();
  tip_velocity_mps_ = Vec3::Zero();
  if (!held_) return;
  const Pose now = controller_->transform().pose();
  // A saber that comes into a hand has come from nowhere.
  last_pose_ = was_held ? pose_ : now;
  pose_ = now;
  if (!was_held) return;
  travel_m_ += (pose_.position - last_pose_.position).norm();
  const Vec3 tip(0.0, 0.0, blade_.tip_m);
  if (dt_s > 0.0) tip_velocity_mps_ = (pose_ * tip - last_pose_ * tip) / dt_s;
}

void Saber::fields(Archive& archive) {
  archive.field("held", held_);
  archive.field("pose", pose_);
  archive.field("last_pose", last_pose_);
  archive.field("tip_velocity", tip_velocity_mps_);
  archive.field("travel", travel_m_);
}

Motion::Motion(const Pose& from, const Pose& to)
    : from_(from),
      travel_m_(to.position - from.position),
      turn_rad_(turnBetween(from.rotation, to.rotation)) {}

Pose Motion::at(double s) const {
  return {from_.position + s * travel_m_, rotationOf(s * turn_rad_) * from_.rotation};
}

Vec3 Motion::velocity(const Vec3& point_m, double s) const {
  return travel_m_ + turn_rad_.cross(point_m - (from_.position + s * travel_m_));
}

double Motion::speedLimit(double radius_m, const Vec3& drift_m) const {
  return (travel_m_ - drift_m).norm() + turn_rad_.norm() * radius_m;
}

Vec3 Segment::nearestTo(const Vec3& point_m) const {
  const Vec3 along = tip_m - root_m;
  const double square = along.squaredNorm();
  if (square <= 0.0) return root_m;
  return root_m + std::clamp((point_m - root_m).dot(along) / square, 0.0, 1.0) * along;
}

Segment segmentOf(const Rod& rod, const Pose& pose) {
  return {pose * Vec3(0.0, 0.0, rod.root_m), pose * Vec3(0.0, 0.0, rod.tip_m)};
}

// The squared distance of root + u along is convex and, between the places where a coordinate
// enters or leaves the block's slab, quadratic: its slope is continuous and piecewise linear in u.
double distance_m(const Segment& segment, const Block& block) {
  const Vec3 root = toBlock(block, segment.root_m);
  const Vec3 along = toBlock(block, segment.tip_m) - root;
  const auto excess_at = [&](double u) { return excessOf(root + u * along, block.half_m); };
  const auto slope_at = [&](double u) { return excess_at(u).dot(along); };

  // In order: 0, where the segment goes through the planes of the sides, 1.
  std::array<double, 8> places{0.0};
  std::size_t count = 1;
  const auto insert = [&](double u) {
    std::size_t i = count++;
    for (; i > 0 && places[i - 1] > u; --i) places[i] = places[i - 1];
    places[i] = u;
  };
  for (int axis = 0; axis < 3; ++axis) {
    if (along[axis] == 0.0) continue;
    for (const double side : {-block.half_m[axis], block.half_m[axis]}) {
      const double u = (side - root[axis]) / along[axis];
      if (u > 0.0 && u < 1.0) insert(u);
    }
  }
  insert(1.0);
  if (slope_at(0.0) >= 0.0) return excess_at(0.0).norm();
  for (std::size_t i = 1; i < count; ++i) {
    const double low = slope_at(places[i - 1]), high = slope_at(places[i]);
    if (high < 0.0) continue;
    const double u = places[i - 1] + (places[i] - places[i - 1]) * low / (low - high);
    return excess_at(u).norm();
  }
  return excess_at(1.0).norm();
}

std::optional<double> firstContact(const Motion& motion, const Rod& rod, const Block& block,
                                   const Vec3& drift_m, double reach_m, double begin, double end) {
  if (begin > end) return std::nullopt;
  const double radius_m = std::max(std::abs(rod.root_m), std::abs(rod.tip_m));
  const double speed = motion.speedLimit(radius_m, drift_m);
  double s = begin;
  while (true) {
    Block moved = block;
    moved.center_m += s * drift_m;
    const double gap_m = distance_m(segmentOf(rod, motion.at(s)), moved) - reach_m;
    if (gap_m < kSweepTolerance_m) return s;
    // Written so that no number at all (a damaged state) is no contact.
    if (!(speed * (end - s) >= gap_m)) return std::nullopt;
    const double next = s + gap_m / speed;
    // So fast that the next moment equals this one in double precision.
    if (next <= s) return s;
    s = next;
  }
}

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

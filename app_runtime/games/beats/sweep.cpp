// SPDX-License-Identifier: Apache-2.0
#include "beats/sweep.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace sim2vr::games::beats {
namespace {

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

}  // namespace

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

}  // namespace sim2vr::games::beats

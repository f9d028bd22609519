// SPDX-License-Identifier: Apache-2.0
// When a moving rod first comes near a moving block. The games' physics room tests where things are
// in a fixed step; a blade that is swung between two frames needs the whole way.
#pragma once

#include <optional>

#include "beats/layout.hpp"
#include "sim2vr/core/math.hpp"

namespace sim2vr::games::beats {

/// A rigid motion between two poses: straight, turning the short way round at constant rate.
class Motion {
 public:
  Motion(const Pose& from, const Pose& to);

  /// s from 0 to 1.
  Pose at(double s) const;
  /// Of a point that is at `point_m` at the moment; per unit of s.
  Vec3 velocity(const Vec3& point_m, double s) const;
  /// No point within `radius_m` of the origin of the moved frame is faster, relative to something
  /// that moves by `drift_m`; metres per unit of s.
  double speedLimit(double radius_m, const Vec3& drift_m) const;

 private:
  Pose from_;
  Vec3 travel_m_;
  /// World axis times the whole angle.
  Vec3 turn_rad_;
};

/// From z = root to z = tip of the moved frame; a point where both are 0.
struct Rod {
  double root_m = 0.0;
  double tip_m = 0.0;
};

struct Segment {
  Vec3 root_m = Vec3::Zero();
  Vec3 tip_m = Vec3::Zero();

  /// The segment's point that is nearest to `point_m`.
  Vec3 nearestTo(const Vec3& point_m) const;
};
Segment segmentOf(const Rod& rod, const Pose& pose);

/// Between a segment and a block, m; 0 where they touch or overlap. Exact.
double distance_m(const Segment& segment, const Block& block);

/// The first s in [begin, end] at which the rod is within `reach_m` of a block that moves by
/// `drift_m` from s = 0 to 1 (and is at `block` at s = 0), to less than kSweepTolerance_m. By
/// conservative advancement: from the distance and the largest speed follows how long nothing can
/// touch (Mirtich, "Impulse-based Dynamic Simulation", 1996, section 2.3).
std::optional<double> firstContact(const Motion& motion, const Rod& rod, const Block& block,
                                   const Vec3& drift_m, double reach_m, double begin = 0.0,
                                   double end = 1.0);
inline constexpr double kSweepTolerance_m = 5e-4;

}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
// Points for how far a blade swings before and after a cut, and for how near the cut comes to the
// box's centre: Beat Saber's (docs/reference/games/beats.md).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "beats/level.hpp"
#include "beats/sweep.hpp"
#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/math.hpp"

namespace sim2vr::games::beats {

inline constexpr double kSwingBefore_deg = 100.0;
inline constexpr double kSwingAfter_deg = 60.0;
inline constexpr double kCentre_m = 0.3;
/// A swing counts for so long before and after the cut.
inline constexpr double kSwing_s = 0.4;

/// 70 for the swing before the cut, 30 for the one after it, 15 for the centre, each rounded.
/// Shares of the full angles; more than 1 counts as 1.
int swingPoints(double before, double after, double centre_m);

/// Angle of a step of the swing that counts: all of it up to 75 degrees between its plane and the
/// cut's, none from 90 degrees on.
double countedAngle_deg(double angle_deg, double between_planes_deg);

/// A blade in a frame.
struct SwingStep {
  double time_s = 0.0;
  Segment blade;
  /// Unit normal of the plane through the blade and the middle of the blade in the frame before;
  /// zero for a blade at rest.
  Vec3 normal = Vec3::Zero();
  /// By which the blade has turned since the frame before.
  double angle_deg = 0.0;

  void fields(Archive& archive);
};

/// What a blade has done in the last 0.4 s.
class Swing {
 public:
  /// Times rise.
  void add(double time_s, const Segment& blade);
  /// A blade that was put down swings anew.
  void clear() { steps_.clear(); }

  bool moves() const { return steps_.size() > 1; }
  const SwingStep& now() const { return steps_.back(); }
  const SwingStep& last() const { return steps_[steps_.size() - 2]; }
  /// Share of kSwingBefore_deg that the blade has turned in one direction up to now. `angle_deg`:
  /// of the latest step, where only part of it counts.
  double before(std::optional<double> angle_deg = std::nullopt) const;

  void fields(Archive& archive) { archive.field("steps", steps_); }

 private:
  /// Oldest first.
  std::vector<SwingStep> steps_;
};

/// A correct cut whose swing goes on.
struct OpenCut {
  std::uint64_t box = 0;
  Hand hand = Hand::kRight;
  /// Of the score, when the box was cut.
  int factor = 1;
  double time_s = 0.0;
  Vec3 normal = Vec3::Zero();
  Vec3 center_m = Vec3::Zero();
  double centre_distance_m = 0.0;
  double before = 0.0;
  double after = 0.0;
  /// Whether the blade's tip has gone through the plane that halves the box across the cut.
  bool halved = false;

  /// The cut of a box, centre at `center_m`, by a blade that moves.
  static OpenCut of(const Swing& swing, const Vec3& center_m);
  /// The next frame of the blade, that of the cut included. Returns whether the swing is over.
  bool follow(const Swing& swing);
  int points() const { return swingPoints(before, after, centre_distance_m); }

  void fields(Archive& archive);
};

}  // namespace sim2vr::games::beats

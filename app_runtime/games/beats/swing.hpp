// SPDX-License-Identifier: Apache-2.0
// Points for how far a blade swings before and after a cut, and for how near the cut comes to the
// box's centre: Beat Saber's (docs/reference/games/beats.md).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "beats/level.hpp"
#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/math.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::games::beats {

// What a cut is worth.

struct ScoreRules {
  /// A slower blade does not cut.
  double min_speed_mps = 0.5;
  /// From here on speed is worth no more.
  double full_speed_mps = 5.0;
  /// Further from the demanded direction than this is wrong.
  double angle_limit_deg = 60.0;
  /// Points for the swing instead of speed and angle.
  bool swing = false;
};

inline constexpr int kLeastPoints = 50;
inline constexpr int kSpeedPoints = 75;
inline constexpr int kAnglePoints = 75;

/// Angle between a blade's velocity, as the player sees it (x right, y up), and what the box
/// demands, 0 to 180 degrees; 0 for "any". None where the blade moves along z alone (less than 1
/// cm/s across the face).
std::optional<double> cutAngle_deg(const Box& box, const Vec3& velocity_mps);

/// Points of a correct slice, 50 to 200.
int cutPoints(const ScoreRules& rules, double speed_mps, double angle_deg);

/// Points count 1, 2, 4 and 8 fold after 0, 2, 6 and 14 correct slices in a row.
class Multiplier {
 public:
  int factor() const { return 1 << tier_; }
  void addSlice();
  /// An error or a miss: half as much, counting anew.
  void addFault();
  void fields(Archive& archive);

 private:
  int tier_ = 0;
  int slices_ = 0;  // towards the next tier
};

// When a moving rod first comes near a moving block. The games' physics room tests where things are
// in a fixed step; a blade that is swung between two frames needs the whole way.

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

// A saber in a hand: a blade rigidly on the grip, and how it moved since the frame before.

/// In the grip's frame the saber lies along +z (docs/reference/games/beats.md).
inline constexpr double kBladeRadius_m = 0.015;

inline xr::Hand controllerOf(Hand hand) {
  return hand == Hand::kLeft ? xr::Hand::left : xr::Hand::right;
}

inline Rod bladeOf(const Layout& layout) {
  return {layout.blade_start_m, layout.blade_start_m + layout.blade_length_m};
}

class Saber {
 public:
  /// `controller` outlives it.
  Saber(Hand hand, const scene::GameObject& controller, const Rod& blade)
      : hand_(hand), controller_(&controller), blade_(blade) {}

  /// Takes over where the controller is, `dt_s` after the last call.
  void follow(double dt_s);

  Hand hand() const { return hand_; }
  /// Whether the controller is on.
  bool held() const { return held_; }
  const Rod& blade() const { return blade_; }
  Segment segment() const { return segmentOf(blade_, pose_); }
  const Pose& pose() const { return pose_; }
  /// Between the last two frames; none when the controller came on in the last.
  Motion motion() const { return {last_pose_, pose_}; }
  /// As the hand moves it, of the tip, over the last frame.
  const Vec3& tipVelocity_mps() const { return tip_velocity_mps_; }
  /// Of the grip since the round's start.
  double travel_m() const { return travel_m_; }

  void fields(Archive& archive);

 private:
  Hand hand_;
  const scene::GameObject* controller_;
  Rod blade_;
  bool held_ = false;
  Pose pose_;
  Pose last_pose_;
  Vec3 tip_velocity_mps_ = Vec3::Zero();
  double travel_m_ = 0.0;
};

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

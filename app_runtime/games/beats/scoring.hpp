// SPDX-License-Identifier: Apache-2.0
// What a cut is worth.
#pragma once

#include <optional>

#include "beats/level.hpp"
#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/math.hpp"

namespace sim2vr::games::beats {

struct ScoreRules {
  /// A slower blade does not cut.
  double min_speed_mps = 0.5;
  /// From here on speed is worth no more.
  double full_speed_mps = 5.0;
  /// Further from the demanded direction than this is wrong.
  double angle_limit_deg = 60.0;
  /// Points for the swing (swing.hpp) instead of speed and angle.
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

}  // namespace sim2vr::games::beats

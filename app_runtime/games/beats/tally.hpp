// SPDX-License-Identifier: Apache-2.0
// What a round has come to so far.
#pragma once

#include <array>
#include <cstddef>

#include "beats/scoring.hpp"
#include "sim2vr/core/archive.hpp"

namespace sim2vr::games::beats {

enum class Fault { kWrongHand, kWrongDirection, kMine, kWall, kMiss };

class Tally {
 public:
  explicit Tally(bool multiply) : multiply_(multiply) {}

  void addSlice(int points, double speed_mps, double angle_deg);
  /// Points of a slice that were not known when it was made.
  void addPoints(int points) { score_ += points; }
  void addFault(Fault fault);
  /// The head was in a wall for that long; `errors_per_second` counts on top of the wall itself.
  void addWallTime(double seconds, double errors_per_second);
  void addAvoidedMine() { ++mines_avoided_; }
  void addAvoidedWall() { ++walls_avoided_; }

  int score() const { return score_; }
  int slices() const { return slices_; }
  int count(Fault fault) const { return faults_.at(static_cast<std::size_t>(fault)); }
  int misses() const { return count(Fault::kMiss); }
  /// All faults but misses, and what was counted for time in walls.
  double errors() const;
  int minesAvoided() const { return mines_avoided_; }
  int wallsAvoided() const { return walls_avoided_; }
  double wall_s() const { return wall_s_; }
  int combo() const { return combo_; }
  int longestCombo() const { return longest_combo_; }
  int factor() const { return multiply_ ? multiplier_.factor() : 1; }
  /// 0 to 1; half at the start.
  double energy() const { return energy_; }
  /// Over the correct slices; 0 without any.
  double meanSpeed_mps() const { return slices_ == 0 ? 0.0 : speed_sum_mps_ / slices_; }
  double meanAngle_deg() const { return slices_ == 0 ? 0.0 : angle_sum_deg_ / slices_; }

  void fields(Archive& archive);

 private:
  void addEnergy(double change);

  bool multiply_;
  int score_ = 0;
  int slices_ = 0;
  std::array<int, 5> faults_{};
  int mines_avoided_ = 0;
  int walls_avoided_ = 0;
  double wall_s_ = 0.0;
  double wall_time_errors_ = 0.0;
  int combo_ = 0;
  int longest_combo_ = 0;
  Multiplier multiplier_;
  double energy_ = 0.5;
  double speed_sum_mps_ = 0.0;
  double angle_sum_deg_ = 0.0;
};

}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
#include "beats/tally.hpp"

#include <algorithm>

namespace sim2vr::games::beats {
namespace {

constexpr double kSliceEnergy = 0.01;
constexpr double kMissEnergy = -0.15;
constexpr double kWrongCutEnergy = -0.10;
constexpr double kMineEnergy = -0.15;
constexpr double kWallEnergy_per_s = -1.3;

double energyOf(Fault fault) {
  switch (fault) {
    case Fault::kWrongHand:
    case Fault::kWrongDirection:
      return kWrongCutEnergy;
    case Fault::kMine:
      return kMineEnergy;
    case Fault::kMiss:
      return kMissEnergy;
    case Fault::kWall:
      break;  // by the time inside
  }
  return 0.0;
}

}  // namespace

void Tally::addSlice(int points, double speed_mps, double angle_deg) {
  score_ += points * factor();
  ++slices_;
  multiplier_.addSlice();
  longest_combo_ = std::max(longest_combo_, ++combo_);
  speed_sum_mps_ += speed_mps;
  angle_sum_deg_ += angle_deg;
  addEnergy(kSliceEnergy);
}

void Tally::addFault(Fault fault) {
  ++faults_.at(static_cast<std::size_t>(fault));
  combo_ = 0;
  multiplier_.addFault();
  addEnergy(energyOf(fault));
}

void Tally::addWallTime(double seconds, double errors_per_second) {
  wall_s_ += seconds;
  wall_time_errors_ += errors_per_second * seconds;
  addEnergy(kWallEnergy_per_s * seconds);
}

double Tally::errors() const {
  return count(Fault::kWrongHand) + count(Fault::kWrongDirection) + count(Fault::kMine) +
         count(Fault::kWall) + wall_time_errors_;
}

// What is used up stays so.
void Tally::addEnergy(double change) {
  if (energy_ > 0.0) energy_ = std::clamp(energy_ + change, 0.0, 1.0);
}

void Tally::fields(Archive& archive) {
  archive.field("score", score_, kCounts);
  archive.field("slices", slices_, kCounts);
  archive.field("faults", faults_, kCounts);
  archive.field("mines_avoided", mines_avoided_, kCounts);
  archive.field("walls_avoided", walls_avoided_, kCounts);
  archive.field("wall_s", wall_s_, kQuantities);
  archive.field("wall_time_errors", wall_time_errors_, kQuantities);
  archive.field("combo", combo_, kCounts);
  archive.field("longest_combo", longest_combo_, kCounts);
  archive.field("multiplier", multiplier_);
  archive.field("energy", energy_, {0.0, 1.0});
  archive.field("speed_sum", speed_sum_mps_, kQuantities);
  archive.field("angle_sum", angle_sum_deg_, kQuantities);
}

}  // namespace sim2vr::games::beats

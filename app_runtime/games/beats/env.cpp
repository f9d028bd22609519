// SPDX-License-Identifier: Apache-2.0
#include "beats/env.hpp"

#include <algorithm>
#include <cmath>

#include "beats/privileged.hpp"

namespace sim2vr::games::beats {
namespace {

// A box is worth approaching for so long before it reaches the cut plane, and afterwards.
constexpr double kApproach_s = 1.0;
constexpr double kApproachRate_per_m = 4.0;

}  // namespace

void Env::declareLog() {
  logTerm("ApproachReward", [this] { return approach_; });
  logTerm("PenaltyReward", [this] { return penalty_; });
  const Tally& tally = round_.tally();
  const auto boxes = static_cast<double>(round_.level().boxes.size());
  logColumn("Boxes", [boxes] { return boxes; });
  logColumn("Score", [&] { return tally.score(); });
  logColumn("AccumulatedCorrectSlices", [&] { return tally.slices(); });
  logColumn("AccumulatedErrors", [&] { return tally.errors(); });
  logColumn("BoxesNotSliced", [&tally, boxes] { return boxes - tally.slices(); });
  logColumn("Misses", [&] { return tally.misses(); });
  logColumn("WrongHand", [&] { return tally.count(Fault::kWrongHand); });
  logColumn("WrongDirection", [&] { return tally.count(Fault::kWrongDirection); });
  logColumn("MineHits", [&] { return tally.count(Fault::kMine); });
  logColumn("MinesAvoided", [&] { return tally.minesAvoided(); });
  logColumn("WallHits", [&] { return tally.count(Fault::kWall); });
  logColumn("WallsAvoided", [&] { return tally.wallsAvoided(); });
  logColumn("WallSeconds", [&] { return tally.wall_s(); });
  logColumn("Combo", [&] { return tally.combo(); });
  logColumn("MaxCombo", [&] { return tally.longestCombo(); });
  logColumn("Multiplier", [&] { return tally.factor(); });
  logColumn("Energy",
            [&, energy = round_.settings().energy] { return energy ? tally.energy() : 1.0; });
  logColumn("CutSpeed", [&] { return tally.meanSpeed_mps(); });
  logColumn("CutAngleError", [&] { return tally.meanAngle_deg(); });
  const Saber& left = round_.saber(Hand::kLeft);
  const Saber& right = round_.saber(Hand::kRight);
  logColumn("HandTravelLeft", [&] { return left.travel_m(); });
  logColumn("HandTravelRight", [&] { return right.travel_m(); });
  logColumn("HandTravel", [&] { return left.travel_m() + right.travel_m(); });
}

double Env::calculateReward() {
  sight_.look();
  const Tally& tally = round_.tally();
  const Settings& settings = round_.settings();
  double reward = tally.score() - score_;
  if (settings.shaped) {
    approach_ = round_.phase() == Round::Phase::kPlay ? approachReward() : 0.0;
    penalty_ = -settings.miss_penalty * (tally.misses() - misses_) -
               settings.error_penalty * (tally.errors() - errors_);
    reward += approach_ + penalty_;
  }
  score_ = tally.score();
  misses_ = tally.misses();
  errors_ = tally.errors();
  return reward;
}

double Env::approachReward() const {
  double sum = 0.0;
  for (const Hand hand : {Hand::kLeft, Hand::kRight}) {
    const std::vector<std::size_t> next = sight_.boxes(hand);
    if (next.empty()) continue;
    const Box& box = round_.level().boxes[next.front()];
    const auto distance_m = sight_.bladeToBox_m(hand);
    if (!distance_m || box.time_s - round_.time_s() > kApproach_s) continue;
    sum += std::exp(-kApproachRate_per_m * *distance_m);
  }
  return round_.settings().approach_reward * round_.frame_s() * sum;
}

float Env::timeFeature() const {
  if (!round_.settings().time_feature) return 0.0F;
  const double lead_in_s = round_.settings().lead_in_s;
  const double share =
      (round_.time_s() + lead_in_s) / std::max(round_.level().length_s + lead_in_s, 1e-9);
  return static_cast<float>(std::clamp(2.0 * share - 1.0, -1.0, 1.0));
}

void Env::fillPrivileged(std::span<float> values) const { writePrivileged(round_, sight_, values); }

void Env::fields(Archive& archive) {
  RLEnv::fields(archive);
  archive.field("sight", sight_);
  archive.field("score", score_, kCounts);
  archive.field("misses", misses_, kCounts);
  archive.field("errors", errors_, kQuantities);
}

}  // namespace sim2vr::games::beats

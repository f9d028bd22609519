#include "beats/env.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "beats/privileged.hpp"

namespace sim2vr::games::beats {
namespace {

// A box is worth approaching for so long before it reaches the cut plane, and afterwards.
constexpr double kApproach_s = 1.0;
constexpr double kApproachRate_per_m = 4.0;

// Left out of what clients get.
constexpr double kNoTerm = std::numeric_limits<double>::quiet_NaN();

}  // namespace

void Env::InitialiseGame() { log_["Boxes"] = static_cast<double>(round_.level().boxes.size()); }

void Env::InitialiseReward() {
  const double term = round_.settings().shaped ? 0.0 : kNoTerm;
  for (const char* name : {"ApproachReward", "PenaltyReward"}) logTerm(name, term);
  updateLog();
}

void Env::CalculateReward() {
  sight_.look();
  const Tally& tally = round_.tally();
  const Settings& settings = round_.settings();
  double reward = tally.score() - score_;
  double approach = kNoTerm, penalty = kNoTerm;
  if (settings.shaped) {
    approach = round_.phase() == Round::Phase::kPlay ? approachReward() : 0.0;
    penalty = -settings.miss_penalty * (tally.misses() - misses_) -
              settings.error_penalty * (tally.errors() - errors_);
    reward += approach + penalty;
  }
  logTerm("ApproachReward", approach);
  logTerm("PenaltyReward", penalty);
  score_ = tally.score();
  misses_ = tally.misses();
  errors_ = tally.errors();
  reward_ = static_cast<float>(reward);
  updateLog();
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

float Env::GetTimeFeature() const {
  if (!round_.settings().time_feature) return 0.0F;
  const double lead_in_s = round_.settings().lead_in_s;
  const double share =
      (round_.time_s() + lead_in_s) / std::max(round_.level().length_s + lead_in_s, 1e-9);
  return static_cast<float>(std::clamp(2.0 * share - 1.0, -1.0, 1.0));
}

void Env::updateLog() {
  const Tally& tally = round_.tally();
  log_["Score"] = tally.score();
  log_["AccumulatedCorrectSlices"] = tally.slices();
  log_["AccumulatedErrors"] = tally.errors();
  log_["BoxesNotSliced"] = log_["Boxes"] - tally.slices();
  log_["Misses"] = tally.misses();
  log_["WrongHand"] = tally.count(Fault::kWrongHand);
  log_["WrongDirection"] = tally.count(Fault::kWrongDirection);
  log_["MineHits"] = tally.count(Fault::kMine);
  log_["MinesAvoided"] = tally.minesAvoided();
  log_["WallHits"] = tally.count(Fault::kWall);
  log_["WallsAvoided"] = tally.wallsAvoided();
  log_["WallSeconds"] = tally.wall_s();
  log_["Combo"] = tally.combo();
  log_["MaxCombo"] = tally.longestCombo();
  log_["Multiplier"] = tally.factor();
  log_["Energy"] = round_.settings().energy ? tally.energy() : 1.0;
  log_["CutSpeed"] = tally.meanSpeed_mps();
  log_["CutAngleError"] = tally.meanAngle_deg();
  const double left_m = round_.saber(Hand::kLeft).travel_m();
  const double right_m = round_.saber(Hand::kRight).travel_m();
  log_["HandTravelLeft"] = left_m;
  log_["HandTravelRight"] = right_m;
  log_["HandTravel"] = left_m + right_m;
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

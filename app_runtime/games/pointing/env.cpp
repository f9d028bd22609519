#include "pointing/env.hpp"

#include <cmath>
#include <limits>

namespace sim2vr::games::pointing {
namespace {

constexpr double kHitReward = 10.0;
constexpr double kDistanceRate_per_m = 10.0;
constexpr double kDistanceWeight = 0.1;
/// In the log: a number that the round has not.
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

double meanOf(double sum, int count) { return count == 0 ? 0.0 : sum / count; }

}  // namespace

void Env::InitialiseGame() {
  log_["Trials"] = static_cast<double>(round_.blocks().size()) * (round_.settings().targets + 1);
}

void Env::InitialiseReward() { updateLog(); }

void Env::CalculateReward() {
  const Tally& tally = round_.tally();
  const bool sparse = round_.settings().sparse;
  const double errors = -round_.settings().error_cost * (tally.errors - errors_);
  const double distance = sparse ? 0.0 : distanceReward();
  reward_ = static_cast<float>(kHitReward * (tally.hits - hits_) + errors + distance);
  logTerm("ErrorReward", errors);
  logTerm("DistanceReward", sparse ? kNone : distance);
  hits_ = tally.hits;
  errors_ = tally.errors;
  updateLog();
  privileged_.look();
}

double Env::distanceReward() const {
  if (round_.phase() != Round::Phase::kPlay) return 0.0;
  const double distance_m = (round_.targetCenter(round_.target()) - round_.stylus().tip_m()).norm();
  return kDistanceWeight * (std::exp(-kDistanceRate_per_m * distance_m) - 1.0) / framesPerStep();
}

void Env::updateLog() {
  const Tally& tally = round_.tally();
  log_["Points"] = tally.hits;
  log_["Errors"] = tally.errors;
  log_["Timeouts"] = tally.timeouts;
  log_["Failures"] = tally.failures();
  log_["Selections"] = tally.hits + tally.errors;
  log_["Movements"] = tally.movements;
  log_["MovementTime"] = meanOf(tally.time_sum_s, tally.movements);
  log_["IndexOfDifficulty"] = meanOf(tally.index_sum_bits, tally.movements);
  log_["Blocks"] = tally.blocks;
  log_["Throughput"] = meanOf(tally.throughput_sum_bps, tally.blocks);
  log_["EffectiveIndex"] = meanOf(tally.effective_index_sum_bits, tally.blocks);
  log_["EndpointSpread"] = std::sqrt(meanOf(tally.variance_sum_m2, tally.blocks));
}

void Env::fields(Archive& archive) {
  RLEnv::fields(archive);
  archive.field("hits", hits_, kCounts);
  archive.field("errors", errors_, kCounts);
  archive.field("privileged", privileged_);
}

}  // namespace sim2vr::games::pointing

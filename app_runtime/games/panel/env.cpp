#include "panel/env.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace sim2vr::games::panel {
namespace {

constexpr double kHitReward = 10.0;
constexpr double kClosenessRate = 5.0;
constexpr double kClosenessWeight = 0.1;
/// In the log: a number that the round has not.
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

}  // namespace

void Env::CalculateReward() {
  const Tally& tally = round_.tally();
  const bool sparse = round_.settings().sparse;
  const double errors = -round_.settings().error_cost * (tally.errors - errors_);
  const double closeness = sparse ? 0.0 : closenessReward();
  reward_ = static_cast<float>(kHitReward * (tally.hits - hits_) + errors + closeness);
  logTerm("ErrorReward", errors);
  logTerm("ClosenessReward", sparse ? kNone : closeness);
  hits_ = tally.hits;
  errors_ = tally.errors;
  updateLog();
}

double Env::closenessReward() const {
  double gap = std::numeric_limits<double>::infinity();
  for (const Pointer& pointer : round_.pointers()) {
    if (pointer.state().active) gap = std::min(gap, pointer.gap(round_.handle_m()));
  }
  return kClosenessWeight * (std::exp(-kClosenessRate * gap) - 1.0) / framesPerStep();
}

void Env::updateLog() {
  const Tally& tally = round_.tally();
  log_["Points"] = tally.hits;
  log_["Errors"] = tally.errors;
  log_["Timeouts"] = tally.timeouts;
  log_["MissedFirst"] = tally.missed_first;
  log_["HitFirst"] = tally.targets - tally.missed_first;
  log_["SelectionTime"] = tally.meanTime_s();
  log_["MedianSelectionTime"] = tally.medianTime_s();
}

void Env::fields(Archive& archive) {
  RLEnv::fields(archive);
  archive.field("hits", hits_, kCounts);
  archive.field("errors", errors_, kCounts);
}

}  // namespace sim2vr::games::panel

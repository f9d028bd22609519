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

void Env::declareLog() {
  const bool sparse = round_.settings().sparse;
  logTerm("ErrorReward", [this] { return error_; });
  logTerm("ClosenessReward", [this, sparse] { return sparse ? kNone : closeness_; });
  const Tally& tally = round_.tally();
  logColumn("Points", [&] { return tally.hits; });
  logColumn("Errors", [&] { return tally.errors; });
  logColumn("Timeouts", [&] { return tally.timeouts; });
  logColumn("MissedFirst", [&] { return tally.missed_first; });
  logColumn("HitFirst", [&] { return tally.targets - tally.missed_first; });
  logColumn("SelectionTime", [&] { return tally.meanTime_s(); });
  logColumn("MedianSelectionTime", [&] { return tally.medianTime_s(); });
}

double Env::calculateReward() {
  const Tally& tally = round_.tally();
  error_ = -round_.settings().error_cost * (tally.errors - errors_);
  closeness_ = round_.settings().sparse ? 0.0 : closenessReward();
  const double hit = kHitReward * (tally.hits - hits_);
  hits_ = tally.hits;
  errors_ = tally.errors;
  return hit + error_ + closeness_;
}

double Env::closenessReward() const {
  double gap = std::numeric_limits<double>::infinity();
  for (const Pointer& pointer : round_.pointers()) {
    if (pointer.state().active) gap = std::min(gap, pointer.gap(round_.handle_m()));
  }
  return kClosenessWeight * (std::exp(-kClosenessRate * gap) - 1.0) / framesPerStep();
}

void Env::fields(Archive& archive) {
  RLEnv::fields(archive);
  archive.field("hits", hits_, kCounts);
  archive.field("errors", errors_, kCounts);
}

}  // namespace sim2vr::games::panel

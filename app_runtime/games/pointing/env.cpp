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

void Env::declareLog() {
  const auto trials =
      static_cast<double>(round_.blocks().size()) * (round_.settings().targets + 1);
  logColumn("Trials", [trials] { return trials; });
  const bool sparse = round_.settings().sparse;
  logTerm("ErrorReward", [this] { return error_; });
  logTerm("DistanceReward", [this, sparse] { return sparse ? kNone : distance_; });
  const Tally& tally = round_.tally();
  logColumn("Points", [&] { return tally.hits; });
  logColumn("Errors", [&] { return tally.errors; });
  logColumn("Timeouts", [&] { return tally.timeouts; });
  logColumn("Failures", [&] { return tally.failures(); });
  logColumn("Selections", [&] { return tally.hits + tally.errors; });
  logColumn("Movements", [&] { return tally.movements; });
  logColumn("MovementTime", [&] { return meanOf(tally.time_sum_s, tally.movements); });
  logColumn("IndexOfDifficulty", [&] { return meanOf(tally.index_sum_bits, tally.movements); });
  logColumn("Blocks", [&] { return tally.blocks; });
  logColumn("Throughput", [&] { return meanOf(tally.throughput_sum_bps, tally.blocks); });
  logColumn("EffectiveIndex", [&] { return meanOf(tally.effective_index_sum_bits, tally.blocks); });
  logColumn("EndpointSpread",
            [&] { return std::sqrt(meanOf(tally.variance_sum_m2, tally.blocks)); });
}

double Env::calculateReward() {
  const Tally& tally = round_.tally();
  error_ = -round_.settings().error_cost * (tally.errors - errors_);
  distance_ = round_.settings().sparse ? 0.0 : distanceReward();
  const double hit = kHitReward * (tally.hits - hits_);
  hits_ = tally.hits;
  errors_ = tally.errors;
  privileged_.look();
  return hit + error_ + distance_;
}

double Env::distanceReward() const {
  if (round_.phase() != Round::Phase::kPlay) return 0.0;
  const double distance_m = (round_.targetCenter(round_.target()) - round_.stylus().tip_m()).norm();
  return kDistanceWeight * (std::exp(-kDistanceRate_per_m * distance_m) - 1.0) / framesPerStep();
}

void Env::fields(Archive& archive) {
  RLEnv::fields(archive);
  archive.field("hits", hits_, kCounts);
  archive.field("errors", errors_, kCounts);
  archive.field("privileged", privileged_);
}

}  // namespace sim2vr::games::pointing

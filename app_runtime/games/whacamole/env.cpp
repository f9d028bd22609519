#include "whacamole/env.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "sim2vr/scene/scene.hpp"
#include "whacamole/hammer.hpp"
#include "whacamole/target.hpp"

namespace sim2vr::games::whacamole {
namespace {

constexpr double kPointReward = 10.0;
constexpr double kContactReward = 2.0;
constexpr double kDistanceRate_per_m = 10.0;
constexpr double kReferenceDistanceWeight = 0.1;
/// In the log: a number that the round has not.
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

double meanOf(double sum, int count) { return count == 0 ? 0.0 : sum / count; }

}  // namespace

void Env::beginRound() {
  points_ = round_.counts().hits;
  first_contacts_ = round_.counts().first_contacts;
}

void Env::declareLog() {
  const Condition& condition = round_.condition();
  logColumn("Placement", [&] { return static_cast<double>(condition.placement) - 1.0; });
  logColumn("MaxTargets", [&] { return condition.max_targets; });
  logColumn("Constrained", [&] { return condition.constrained ? 1.0 : 0.0; });
  const bool sparse = round_.settings().sparse;
  logTerm("RewardUnsuccessfulContact", [this, sparse] { return sparse ? kNone : contact_; });
  logTerm("DistanceReward", [this, sparse] { return sparse ? kNone : distance_; });
  const Counts& counts = round_.counts();
  logColumn("Points", [&] { return counts.hits; });
  logColumn("Misses", [&] { return counts.misses; });
  logColumn("Contacts", [&] { return counts.contacts; });
  logColumn("HitSpeedSum", [&] { return counts.hit_speed_sum_mps; });
  logColumn("HitSpeed", [&] { return meanOf(counts.hit_speed_sum_mps, counts.hits); });
  logColumn("HitLatency", [&] { return meanOf(counts.hit_latency_sum_s, counts.hits); });
  logColumn("HammerDepthZ", [&] { return meanOf(counts.depth_z_sum_m, counts.play_frames); });
  logColumn("HammerDepthNormal",
            [&] { return meanOf(counts.depth_normal_sum_m, counts.play_frames); });
  for (int cell = 0; cell < kCells; ++cell) {
    const std::string number = std::to_string(cell);
    const auto i = static_cast<std::size_t>(cell);
    logColumn("failrateTarget" + number, [this, cell] { return round_.tally().failRate(cell); });
    logColumn("hitsTarget" + number, [this, i] { return round_.tally().hits[i]; });
    logColumn("missesTarget" + number, [this, i] { return round_.tally().misses[i]; });
  }
}

double Env::calculateReward() {
  double reward = kPointReward * (round_.counts().hits - points_);
  contact_ = contactReward();
  distance_ = distanceReward();
  if (!round_.settings().sparse) reward += contact_ + distance_;
  points_ = round_.counts().hits;
  first_contacts_ = round_.counts().first_contacts;
  privileged_.look();
  return reward;
}

double Env::contactReward() const {
  const Counts& counts = round_.counts();
  const double strike = std::max(0.0, counts.last_contact_strike_mps);
  const double sign = round_.settings().reward == RewardKind::kPaper ? -1.0 : 1.0;
  return sign * kContactReward * (counts.first_contacts - first_contacts_) * strike /
         static_cast<double>(kStrikeThreshold_mps);
}

double Env::distanceReward() const {
  const double weight =
      round_.settings().reward == RewardKind::kPaper ? 1.0 : kReferenceDistanceWeight;
  const Vec3 marker = round_.hammer().markerPosition();
  double sum = 0.0;
  scene().forEach<Target>([&](Target& target) {
    if (target.state() != Target::State::kAlive) return;
    const double distance_m = (target.transform().position() - marker).norm();
    sum += weight * (std::exp(-kDistanceRate_per_m * distance_m) - 1.0);
  });
  return sum / framesPerStep();
}

bool Env::isOver() const { return round_.phase() == Round::Phase::kDone; }

float Env::timeFeature() const {
  return 2.0F * (round_.elapsed_s() / round_.settings().round_s) - 1.0F;
}

void Env::fields(Archive& archive) {
  RLEnv::fields(archive);
  archive.field("points", points_, kCounts);
  archive.field("first_contacts", first_contacts_, kCounts);
  archive.field("privileged", privileged_);
}

}  // namespace sim2vr::games::whacamole

#include "whacamole/env.hpp"

#include <algorithm>
#include <array>
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

struct CellNames {
  std::string fail_rate, hits, misses;
};

// Made once: the log is written in every frame.
const std::array<CellNames, kCells> kCellNames = [] {
  std::array<CellNames, kCells> names;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::string number = std::to_string(i);
    names[i] = {"failrateTarget" + number, "hitsTarget" + number, "missesTarget" + number};
  }
  return names;
}();

double meanOf(double sum, int count) { return count == 0 ? 0.0 : sum / count; }

}  // namespace

void Env::InitialiseGame() {
  const Condition& condition = round_.condition();
  log_["Placement"] = static_cast<double>(condition.placement) - 1.0;  // -1 low, 0 mid, 1 high
  log_["MaxTargets"] = condition.max_targets;
  log_["Constrained"] = condition.constrained ? 1.0 : 0.0;
}

void Env::InitialiseReward() {
  points_ = round_.counts().hits;
  first_contacts_ = round_.counts().first_contacts;
  updateLog();
}

void Env::CalculateReward() {
  double reward = kPointReward * (round_.counts().hits - points_);
  const double contact = contactReward();
  const double distance = distanceReward();
  if (!round_.settings().sparse) reward += contact + distance;
  points_ = round_.counts().hits;
  first_contacts_ = round_.counts().first_contacts;
  logTerm("RewardUnsuccessfulContact", round_.settings().sparse ? kNone : contact);
  logTerm("DistanceReward", round_.settings().sparse ? kNone : distance);
  reward_ = static_cast<float>(reward);
  updateLog();
  privileged_.look();
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

void Env::UpdateIsFinished() { finished_ = round_.phase() == Round::Phase::kDone; }

float Env::GetTimeFeature() const {
  return 2.0F * (round_.elapsed_s() / round_.settings().round_s) - 1.0F;
}

void Env::updateLog() {
  const Counts& counts = round_.counts();
  log_["Points"] = counts.hits;
  log_["Misses"] = counts.misses;
  log_["Contacts"] = counts.contacts;
  log_["HitSpeedSum"] = counts.hit_speed_sum_mps;
  log_["HitSpeed"] = meanOf(counts.hit_speed_sum_mps, counts.hits);
  log_["HitLatency"] = meanOf(counts.hit_latency_sum_s, counts.hits);
  log_["HammerDepthZ"] = meanOf(counts.depth_z_sum_m, counts.play_frames);
  log_["HammerDepthNormal"] = meanOf(counts.depth_normal_sum_m, counts.play_frames);
  for (int cell = 0; cell < kCells; ++cell) {
    const auto i = static_cast<std::size_t>(cell);
    log_[kCellNames[i].fail_rate] = round_.tally().failRate(cell);
    log_[kCellNames[i].hits] = round_.tally().hits[i];
    log_[kCellNames[i].misses] = round_.tally().misses[i];
  }
}

void Env::fields(Archive& archive) {
  RLEnv::fields(archive);
  archive.field("points", points_, kCounts);
  archive.field("first_contacts", first_contacts_, kCounts);
  archive.field("privileged", privileged_);
}

}  // namespace sim2vr::games::whacamole

// SPDX-License-Identifier: Apache-2.0
#include "whacamole/spawner.hpp"

#include <numeric>
#include <string>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::whacamole {
namespace {

constexpr float kMaximumPause_s = 0.5F;
constexpr float kTargetSize_m = 0.025F;
constexpr float kLife_s = 1.0F;

}  // namespace

Spawner::Spawner(std::uint32_t seed, CellWeights weights, std::vector<ScheduledSpawn> schedule)
    : random_(seed), weights_(std::move(weights)), schedule_(std::move(schedule)) {}

std::optional<Spawn> Spawner::next(float time_s, int live, int max_targets) {
  if (!schedule_.empty()) return nextScheduled(time_s);
  if (live >= max_targets || !(time_s > pause_end_s_) || free_.empty()) return std::nullopt;
  // The order of the draws is the reference's; a size of fixed range still costs a draw.
  pause_end_s_ = time_s + random_.range(0.0F, kMaximumPause_s);
  random_.range(kTargetSize_m, kTargetSize_m);
  Spawn spawn;
  spawn.cell = takeCell();
  random_.range(kLife_s, kLife_s);
  spawn.id = next_id_++;
  return spawn;
}

std::optional<Spawn> Spawner::nextScheduled(float time_s) {
  const auto next = static_cast<std::size_t>(next_id_);
  if (next >= schedule_.size() || time_s < schedule_[next].time_s) return std::nullopt;
  return Spawn{.id = next_id_++, .cell = schedule_[next].cell};
}

int Spawner::takeCell() {
  if (!weights_.empty()) return takeWeightedCell();
  random_.shuffle(free_);
  const int cell = free_.front();
  free_.erase(free_.begin());
  return cell;
}

int Spawner::takeWeightedCell() {
  float total = 0.0F;
  for (const int cell : free_) total += weights_[static_cast<std::size_t>(cell)];
  float left = random_.range(0.0F, total);
  auto chosen = free_.end() - 1;
  for (auto it = free_.begin(); it != free_.end(); ++it) {
    left -= weights_[static_cast<std::size_t>(*it)];
    if (left < 0.0F) {
      chosen = it;
      break;
    }
  }
  const int cell = *chosen;
  free_.erase(chosen);
  return cell;
}

void Spawner::fields(Archive& archive) {
  archive.field("random", random_);
  archive.field("weights", weights_, {0.0, 1.0e3});
  if (!weights_.empty() && weights_.size() != kCells) {
    throw EngineError("saved state: field 'weights': got " + std::to_string(weights_.size()) +
                      " numbers, expected " + std::to_string(kCells) + " or none");
  }
  archive.field("free", free_, {0.0, kCells - 1});
  archive.field("pause_end_s", pause_end_s_, kQuantities);
  archive.field("next_id", next_id_, kCounts);
}

CellWeights adaptiveWeights(const std::array<double, kCells>& fail_rates) {
  const double mean = std::accumulate(fail_rates.begin(), fail_rates.end(), 0.0) / kCells;
  if (mean <= 0.0) return {};
  CellWeights weights;
  for (const double rate : fail_rates) weights.push_back(static_cast<float>(rate + mean));
  return weights;
}

}  // namespace sim2vr::games::whacamole

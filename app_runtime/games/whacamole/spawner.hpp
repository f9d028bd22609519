// SPDX-License-Identifier: Apache-2.0
// When and where the next target appears, drawn or from a list: the only user of the round's random
// numbers.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/random.hpp"
#include "whacamole/conditions.hpp"

namespace sim2vr::games::whacamole {

struct Spawn {
  int id = 0;
  int cell = 0;
};

class Spawner {
 public:
  /// Draws the spawns, or takes them from `schedule` where that is not empty.
  Spawner(std::uint32_t seed, CellWeights weights, std::vector<ScheduledSpawn> schedule = {});

  /// A spawn at frame time `time_s`, or nothing. Drawn: nothing when `live` targets (fading ones
  /// included) are already `max_targets`, or the pause after the last spawn is not over. From the
  /// schedule: the next one that is due, whatever lives.
  std::optional<Spawn> next(float time_s, int live, int max_targets);

  /// Gives a cell back once its target has disappeared.
  void release(int cell) {
    if (schedule_.empty()) free_.push_back(cell);
  }

  void fields(Archive& archive);

 private:
  std::optional<Spawn> nextScheduled(float time_s);
  int takeCell();
  int takeWeightedCell();

  Random random_;
  CellWeights weights_;
  std::vector<ScheduledSpawn> schedule_;
  std::vector<int> free_{0, 3, 6, 1, 4, 7, 2, 5, 8};
  float pause_end_s_ = 0.0F;
  int next_id_ = 0;
};

/// Adaptive curriculum: weight_i = fail rate_i + mean fail rate, of the last round. Equal weights
/// (none) when nothing failed.
CellWeights adaptiveWeights(const std::array<double, kCells>& fail_rates);

}  // namespace sim2vr::games::whacamole

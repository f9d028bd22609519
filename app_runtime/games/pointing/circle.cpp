// SPDX-License-Identifier: Apache-2.0
#include "pointing/circle.hpp"

#include <cmath>
#include <numbers>

#include "sim2vr/core/random.hpp"

namespace sim2vr::games::pointing {

double Block::index_bits() const { return std::log2(distance_m / width_m + 1.0); }

std::vector<Block> drawBlocks(const Settings& settings, std::uint32_t seed) {
  std::vector<Block> all;
  Random random(seed);
  // The first words of neighbouring seeds resemble each other.
  for (int i = 0; i < 8; ++i) random.next();
  for (int i = 0; i < settings.repeats; ++i) {
    std::vector<Block> once;
    for (const double distance_m : settings.distances_m) {
      for (const double width_m : settings.widths_m) once.push_back({distance_m, width_m});
    }
    random.shuffle(once);
    all.insert(all.end(), once.begin(), once.end());
  }
  return all;
}

int targetOfTrial(int trial, int targets) { return trial * ((targets + 1) / 2) % targets; }

Vec3 targetCenter_m(int target, int targets, double distance_m) {
  const double radius_m = 0.5 * distance_m / std::cos(std::numbers::pi / (2.0 * targets));
  const double angle = 2.0 * std::numbers::pi * target / targets;
  return {radius_m * std::sin(angle), radius_m * std::cos(angle), 0.0};
}

}  // namespace sim2vr::games::pointing

// Levels made of a seed, for training and for levels that nobody has seen.
#pragma once

#include <string>

namespace sim2vr::games::beats {

struct GeneratorSettings {
  /// Boxes per second.
  double density_hz = 1.0;
  /// One of patternNames().
  std::string pattern = "mixed";
  /// Of approach, m/s.
  double speed_mps = 8.0;
  /// Walls and mines per minute.
  double walls_per_min = 6.0;
  double mines_per_min = 6.0;
  double seconds = 60.0;
};

}  // namespace sim2vr::games::beats

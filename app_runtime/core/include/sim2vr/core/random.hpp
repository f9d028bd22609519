// SPDX-License-Identifier: Apache-2.0
// The games' random generator: 128-bit xorshift with Unity's seeding and range rules, so that a
// "random seed N" in a recording means the same round here.
#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "sim2vr/core/archive.hpp"

namespace sim2vr {

class Random {
 public:
  explicit Random(std::uint32_t seed = 0) { this->seed(seed); }

  /// State word 0 = seed, following words x -> x * 1812433253 + 1 (mod 2^32).
  void seed(std::uint32_t seed);

  /// Next 32 random bits (shifts 11, 8, 19).
  std::uint32_t next();

  /// Uniform integer in [low, high). Throws InvalidArgument when high <= low.
  int range(int low, int high);

  /// Uniform float in [low, high], from 23 bits: q * low + (1 - q) * high, in binary32.
  float range(float low, float high);

  /// In-place shuffle: position i is swapped with a uniform position in [i, n), i = 0 .. n-2.
  template <class T>
  void shuffle(std::vector<T>& items) {
    for (int i = 0; i + 1 < static_cast<int>(items.size()); ++i) {
      std::swap(items[static_cast<std::size_t>(i)],
                items[static_cast<std::size_t>(range(i, static_cast<int>(items.size())))]);
    }
  }

  void fields(Archive& archive) { archive.field("state", state_); }

 private:
  std::array<std::uint32_t, 4> state_{};
};

}  // namespace sim2vr

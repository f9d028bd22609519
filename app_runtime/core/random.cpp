// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/random.hpp"

#include <string>

#include "sim2vr/core/errors.hpp"

namespace sim2vr {

void Random::seed(std::uint32_t seed) {
  state_[0] = seed;
  for (std::size_t i = 1; i < state_.size(); ++i) state_[i] = state_[i - 1] * 1812433253U + 1U;
}

std::uint32_t Random::next() {
  const std::uint32_t mixed = state_[0] ^ (state_[0] << 11);
  state_[0] = state_[1];
  state_[1] = state_[2];
  state_[2] = state_[3];
  state_[3] = state_[3] ^ (state_[3] >> 19) ^ mixed ^ (mixed >> 8);
  return state_[3];
}

int Random::range(int low, int high) {
  if (high <= low) {
    throw InvalidArgument("high", std::to_string(high),
                          "an integer above low = " + std::to_string(low));
  }
  return low + static_cast<int>(next() % static_cast<std::uint32_t>(high - low));
}

float Random::range(float low, float high) {
  const float q = static_cast<float>(next() & 0x7FFFFFU) / 8388607.0F;
  return q * low + (1.0F - q) * high;
}

}  // namespace sim2vr

// One number after the other into a game's privileged numbers.
#pragma once

#include <cstddef>
#include <span>

#include "sim2vr/core/math.hpp"

namespace sim2vr::rl {

/// Writes into a span from its beginning; whoever writes sees to it that there is room.
class NumberWriter {
 public:
  explicit NumberWriter(std::span<float> values) : values_(values) {}

  void number(double value) { values_[next_++] = static_cast<float>(value); }
  void flag(bool value) { number(value ? 1.0 : 0.0); }
  void vector(const Vec3& value) {
    for (const double of_axis : value) number(of_axis);
  }

 private:
  std::span<float> values_;
  std::size_t next_ = 0;
};

}  // namespace sim2vr::rl

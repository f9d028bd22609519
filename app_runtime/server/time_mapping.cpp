// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/server/time_mapping.hpp"

#include <cmath>
#include <string>

#include "sim2vr/core/clock.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::server {
namespace {

constexpr double kLatest_s = 1e9;
constexpr double kGridTolerance = 1e-6;
constexpr double kGridTolerancePerState = 1e-8;

}  // namespace

std::int64_t frameTimeNs(double time_s, int sample_frequency_hz) {
  if (!(time_s >= 0.0 && time_s <= kLatest_s)) {
    throw InvalidArgument("time", std::to_string(time_s) + " s", "0 to 1e9 s");
  }
  const double states = time_s * sample_frequency_hz;
  const double n = std::round(states);
  if (std::abs(states - n) <= kGridTolerance + kGridTolerancePerState * n) {
    return lockstepFrameTimeNs(static_cast<std::int64_t>(n), sample_frequency_hz);
  }
  return std::llround(time_s * 1e9);
}

}  // namespace sim2vr::server

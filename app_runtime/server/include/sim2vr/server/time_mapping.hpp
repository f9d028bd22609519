// SPDX-License-Identifier: Apache-2.0
// From a user's clock in seconds to game time in integer nanoseconds.
#pragma once

#include <cstdint>

namespace sim2vr::server {

/// Game time at `time_s` on the clock of a user who sends `sample_frequency_hz` states per second.
/// Where time_s lies on the grid of states, n / sample_frequency_hz, it is
/// lockstepFrameTimeNs(n, sample_frequency_hz); elsewhere it is time_s rounded to a nanosecond.
/// "On the grid" means within 1e-6 + 1e-8 n periods: a clock that adds up 2 ms substeps in
/// binary64, as MuJoCo's does, is 2e-4 periods off after 10^6 states and must not drift against the
/// fixed steps. Throws InvalidArgument ("time") unless time_s is from 0 to 1e9.
std::int64_t frameTimeNs(double time_s, int sample_frequency_hz);

}  // namespace sim2vr::server

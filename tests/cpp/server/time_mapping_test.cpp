// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/server/message.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "sim2vr/core/clock.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::server {
namespace {

TEST(TimeMapping, StatesOnTheGridAreFramesOfTheLockstep) {
  // The largest binary32 number below 0.05 is 0.04999999701976776.
  EXPECT_EQ(frameTimeNs(0.0, 20), 0);
  EXPECT_EQ(frameTimeNs(0.05, 20), 49'999'997);
  EXPECT_EQ(frameTimeNs(0.1 + 0.05, 20), 149'999'991);
  EXPECT_EQ(frameTimeNs(60.0, 20), 59'999'996'424);
}

TEST(TimeMapping, OthersAreRoundedToANanosecond) {
  EXPECT_EQ(frameTimeNs(0.0123456789, 20), 12'345'679);
  // 2e-6 of a period off: not the frame's time.
  EXPECT_EQ(frameTimeNs(0.0500001, 20), 50'000'100);
}

TEST(TimeMapping, AClockThatAddsUpSubstepsDoesNotDriftOverAMillionStates) {
  double time_s = 0.0;
  std::int64_t previous_ns = 0;
  for (std::int64_t n = 1; n <= 1'000'000; ++n) {
    for (int substep = 0; substep < 25; ++substep) time_s += 0.002;
    const std::int64_t time_ns = frameTimeNs(time_s, 20);
    ASSERT_EQ(time_ns, lockstepFrameTimeNs(n, 20)) << "state " << n;
    ASSERT_GT(time_ns, previous_ns);
    previous_ns = time_ns;
  }
  // The sum itself is 9 microseconds off by then.
  EXPECT_GT(std::abs(time_s - 50'000.0), 5e-6);
}

TEST(TimeMapping, RefusesTimesThatAreNone) {
  for (const double time_s : {-0.05, 1e10, std::numeric_limits<double>::quiet_NaN(),
                              std::numeric_limits<double>::infinity()}) {
    EXPECT_THROW(frameTimeNs(time_s, 20), InvalidArgument) << time_s;
  }
}

}  // namespace
}  // namespace sim2vr::server

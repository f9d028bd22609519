// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/clock.hpp"

#include <gtest/gtest.h>
#include <cstring>

#include <cstdint>
#include <vector>

#include "sim2vr/core/errors.hpp"

namespace sim2vr {
namespace {

constexpr std::int64_t kMs = 1'000'000;

std::vector<float> fixedTimes(GameClock& clock, std::int64_t frame_ns) {
  clock.beginFrame(frame_ns);
  std::vector<float> times;
  while (clock.beginFixedStep()) {
    times.push_back(clock.fixedTime());
    clock.endFixedStep();
  }
  return times;
}

// Periods of 1/64 s and the like are exact in binary32 and in ns.
TimeSettings stepEvery(double period_s) {
  TimeSettings settings;
  settings.fixed_delta_time_s = period_s;
  settings.maximum_delta_time_s = 2000.0;
  return settings;
}

TEST(GameClock, FixedStepsLieOnTheGridAndBelongToTheFirstFrameThatReachesThem) {
  GameClock clock(stepEvery(1.0 / 64));  // 15.625 ms
  EXPECT_EQ(fixedTimes(clock, 40 * kMs), (std::vector<float>{0.015625F, 0.03125F}));
  EXPECT_EQ(fixedTimes(clock, 46'875'000), (std::vector<float>{0.046875F}))
      << "a tie is this one's";
  EXPECT_EQ(fixedTimes(clock, 62'499'999), (std::vector<float>{}));
  EXPECT_EQ(fixedTimes(clock, 80 * kMs), (std::vector<float>{0.0625F, 0.078125F}));
}

TEST(GameClock, ValuesAreUnitysBinary32) {
  GameClock clock(stepEvery(1.0 / 64));
  clock.beginFrame(50'000'003);
  EXPECT_EQ(clock.time(), 0.050000003F);
  EXPECT_EQ(clock.deltaTime(), 0.050000003F);
  ASSERT_TRUE(clock.beginFixedStep());
  EXPECT_EQ(clock.time(), 0.015625F) << "within a fixed step time reads fixedTime";
  EXPECT_EQ(clock.deltaTime(), 0.015625F);
  clock.endFixedStep();
  EXPECT_EQ(clock.time(), 0.050000003F);
}

// The binary32 number nearest to 0.001 is 0.001000000047497451: step 1,000,000 lies 47497 ns late.
TEST(GameClock, PeriodIsTheNearestBinary32) {
  GameClock clock(stepEvery(0.001));
  clock.restart(999'999'000'000);
  EXPECT_EQ(fixedTimes(clock, 1'000'000'047'000).size(), 1U) << "step 999,999";
  EXPECT_EQ(fixedTimes(clock, 1'000'000'048'000).size(), 1U) << "step 1,000,000";
}

// The recorded 70 Hz step is the binary32 number 0.0142857134342, 0.85 ns below 1/70 s.
TEST(GameClock, SeventyHertzGrid) {
  TimeSettings settings;
  settings.fixed_delta_time_s = 0.01428571343F;
  settings.maximum_delta_time_s = 1.0;
  GameClock clock(settings);
  EXPECT_EQ(fixedTimes(clock, 1'000'000'000).size(), 70U);  // 70 h = 0.99999994 s
  EXPECT_EQ(clock.fixedTime(), 0.99999994F);
  // Step 4200 lies at 59.9999964 s, step 4201 at 60.0142821 s.
  for (std::int64_t s = 2; s <= 60; ++s) fixedTimes(clock, s * 1'000'000'000);
  EXPECT_FLOAT_EQ(clock.fixedTime(), 59.9999964F);
  EXPECT_EQ(fixedTimes(clock, 60'014'282'000).size(), 0U);
  EXPECT_EQ(fixedTimes(clock, 60'014'283'000).size(), 1U);
}

// Frames at n * 0.049999997 s lie just below the grid's 0.05 n: 24 steps in the first, then 25.
TEST(GameClock, SimulatedUserFramesJustBelowTheGrid) {
  GameClock clock;
  EXPECT_EQ(fixedTimes(clock, 49'999'997).size(), 24U);
  for (std::int64_t n = 2; n <= 1200; ++n) {
    const auto times = fixedTimes(clock, n * 49'999'997);
    ASSERT_EQ(times.size(), 25U) << "frame " << n;
    const double last_s = static_cast<double>(25 * n - 1) * static_cast<double>(0.002F);
    ASSERT_EQ(times.back(), static_cast<float>(last_s)) << "frame " << n;
  }
}

TEST(GameClock, NoDriftOverAMillionSteps) {
  TimeSettings settings;
  settings.fixed_delta_time_s = 1.0 / 1024.0;  // exact in binary32
  settings.maximum_delta_time_s = 2000.0;
  GameClock clock(settings);
  clock.beginFrame(976'562'500'000);
  int steps = 0;
  while (clock.beginFixedStep()) {
    ++steps;
    clock.endFixedStep();
  }
  EXPECT_EQ(steps, 1'000'000);
  EXPECT_EQ(clock.fixedTime(), 976.5625F);
}

TEST(GameClock, LockstepFramesLieAHairBelowTheGrid) {
  // The largest binary32 below 0.05 is 0.0499999970197678 (its neighbour above is 0.0500000007).
  EXPECT_EQ(lockstepFrameTimeNs(0, 20), 0);
  EXPECT_EQ(lockstepFrameTimeNs(1, 20), 49'999'997);
  EXPECT_EQ(lockstepFrameTimeNs(1200, 20), 59'999'996'424);  // 1200 * 49999997.0197678
  EXPECT_EQ(lockstepFrameTimeNs(1, 72), 13'888'888);         // 0.0138888880610466
  EXPECT_EQ(lockstepFrameTimeNs(1, 64), 15'624'999);  // 0.0156249990686774, below the exact 1/64
  // Every frame but the first gets 25 steps of 2 ms, for as long as anyone plays (here 1 h).
  GameClock clock;
  for (int frame = 1; frame <= 72000; ++frame) {
    const auto steps = fixedTimes(clock, lockstepFrameTimeNs(frame, 20)).size();
    ASSERT_EQ(steps, frame == 1 ? 24U : 25U) << "frame " << frame;
  }
  EXPECT_THROW(lockstepFrameTimeNs(-1, 20), InvalidArgument);
  EXPECT_THROW(lockstepFrameTimeNs(1, 0), InvalidArgument);
}

TEST(GameClock, LongFrameAdvancesByTheMaximumOnly) {
  TimeSettings settings;
  settings.fixed_delta_time_s = 0.125;
  settings.maximum_delta_time_s = 0.3;
  GameClock clock(settings);
  EXPECT_EQ(fixedTimes(clock, 1000 * kMs).size(), 2U);  // 0.125 and 0.25
  EXPECT_EQ(clock.deltaTime(), 0.3F);
  EXPECT_EQ(clock.timeNs(), 300 * kMs);
  EXPECT_EQ(fixedTimes(clock, 1080 * kMs).size(), 1U);  // 0.38 s: the lost 0.7 s stay lost
  EXPECT_EQ(clock.timeNs(), 380 * kMs);
}

TEST(GameClock, RestartSkipsStepsUpToItsTime) {
  GameClock clock(stepEvery(0.125));
  clock.restart(250 * kMs);
  EXPECT_EQ(clock.time(), 0.25F);
  EXPECT_EQ(clock.deltaTime(), 0.0F);
  EXPECT_EQ(fixedTimes(clock, 374 * kMs), (std::vector<float>{}));
  EXPECT_EQ(fixedTimes(clock, 375 * kMs), (std::vector<float>{0.375F}));
}

TEST(GameClock, ToleranceTakesRoundedTimeStamps) {
  TimeSettings settings;
  settings.fixed_delta_time_s = 0.02;
  settings.fixed_step_tolerance_s = 1e-5;
  GameClock clock(settings);
  EXPECT_EQ(fixedTimes(clock, 39'991'000).size(), 2U);
  EXPECT_EQ(fixedTimes(clock, 59'989'000).size(), 0U);
}

TEST(GameClock, BackwardsTimeIsRefused) {
  GameClock clock;
  clock.beginFrame(10);
  clock.beginFrame(10);  // standing still is fine
  try {
    clock.beginFrame(9);
    FAIL() << "no error";
  } catch (const InvalidArgument& error) {
    EXPECT_STREQ(error.what(),
                 "time_ns: got 9, expected a time not before the previous frame's 10 "
                 "(clocks must not go backwards)");
  }
}

TEST(GameClock, SettingsAreChecked) {
  const auto field_of = [](auto change) {
    TimeSettings settings;
    change(settings);
    try {
      const GameClock clock(settings);
    } catch (const InvalidArgument& error) {
      return error.field();
    }
    return std::string("none");
  };
  EXPECT_EQ(field_of([](TimeSettings&) {}), "none");
  EXPECT_EQ(field_of([](TimeSettings& s) { s.fixed_delta_time_s = 0.0; }), "fixed_delta_time_s");
  EXPECT_EQ(field_of([](TimeSettings& s) { s.maximum_delta_time_s = -1.0; }),
            "maximum_delta_time_s");
  EXPECT_EQ(field_of([](TimeSettings& s) { s.time_scale = 0.0 / 0.0; }), "time_scale");
  EXPECT_EQ(field_of([](TimeSettings& s) { s.target_frame_rate = 0; }), "target_frame_rate");
  EXPECT_EQ(field_of([](TimeSettings& s) { s.fixed_step_tolerance_s = 0.002; }),
            "fixed_step_tolerance_s");
  // No frame takes minutes.
  EXPECT_EQ(field_of([](TimeSettings& s) { s.fixed_delta_time_s = 9e-6; }), "fixed_delta_time_s");
  EXPECT_EQ(field_of([](TimeSettings& s) { s.maximum_delta_time_s = 20'001.0; }),
            "maximum_delta_time_s");
}

TEST(GameClock, DamagedStatesAreRefused) {
  GameClock clock;
  fixedTimes(clock, 49'999'997);
  Archive saved = Archive::saver();
  clock.fields(saved);
  const auto refusal = [&saved](const std::string& field, auto value) {
    std::string bytes = saved.bytes();
    const std::size_t at = bytes.find(field) + field.size();
    std::memcpy(bytes.data() + at, &value, sizeof(value));
    Archive loader = Archive::loader(bytes);
    try {
      GameClock().fields(loader);
    } catch (const EngineError& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  EXPECT_EQ(refusal("fixed_delta_time_s", 0.002), "accepted");
  EXPECT_EQ(refusal("fixed_delta_time_s", 0.0),
            "saved state: fixed_delta_time_s: got 0.000000, expected a finite number above 0");
  EXPECT_EQ(refusal("caller_time_ns", std::int64_t{-1}), "saved state: a clock at -1 ns");
  // 24 steps of 2 ms have been done by then.
  EXPECT_EQ(refusal("\x0a"
                    "fixed_step",
                    std::int64_t{26}),
            "saved state: fixed step 26 at 49999997 ns");
}

TEST(GameClock, ContinuesAfterLoad) {
  GameClock clock;
  fixedTimes(clock, 49'999'997);
  Archive saved = Archive::saver();
  clock.fields(saved);
  GameClock other;
  Archive loader = Archive::loader(saved.bytes());
  other.fields(loader);
  loader.expectEnd();
  EXPECT_EQ(other.time(), clock.time());
  EXPECT_EQ(other.deltaTime(), clock.deltaTime());
  EXPECT_EQ(fixedTimes(other, 2 * 49'999'997), fixedTimes(clock, 2 * 49'999'997));
}

}  // namespace
}  // namespace sim2vr

#include "sim2vr/core/clock.hpp"

#include <gtest/gtest.h>

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

TEST(GameClock, FixedStepsLieOnTheGridAndBelongToTheFirstFrameThatReachesThem) {
  TimeSettings settings;
  settings.fixed_delta_time_s = 0.02;
  GameClock clock(settings);
  EXPECT_EQ(fixedTimes(clock, 50 * kMs), (std::vector<float>{0.02F, 0.04F}));
  EXPECT_EQ(fixedTimes(clock, 60 * kMs), (std::vector<float>{0.06F})) << "a tie is this frame's";
  EXPECT_EQ(fixedTimes(clock, 79 * kMs), (std::vector<float>{}));
  EXPECT_EQ(fixedTimes(clock, 100 * kMs), (std::vector<float>{0.08F, 0.1F}));
}

TEST(GameClock, ValuesAreUnitysBinary32) {
  TimeSettings settings;
  settings.fixed_delta_time_s = 0.02;
  GameClock clock(settings);
  clock.beginFrame(50'000'003);
  EXPECT_EQ(clock.time(), 0.050000003F);
  EXPECT_EQ(clock.deltaTime(), 0.050000003F);
  ASSERT_TRUE(clock.beginFixedStep());
  EXPECT_EQ(clock.time(), 0.02F) << "within a fixed step time reads fixedTime";
  EXPECT_EQ(clock.deltaTime(), 0.02F);
  clock.endFixedStep();
  EXPECT_EQ(clock.time(), 0.050000003F);
  EXPECT_EQ(clock.frameCount(), 1);
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
    const double last_s = static_cast<double>(n) * 0.05 - 0.002;
    ASSERT_EQ(times.back(), static_cast<float>(last_s)) << "frame " << n;
  }
}

TEST(GameClock, NoDriftOverAMillionSteps) {
  TimeSettings settings;
  settings.fixed_delta_time_s = 0.001;
  settings.maximum_delta_time_s = 2000.0;
  GameClock clock(settings);
  clock.beginFrame(1'000'000 * kMs);
  int steps = 0;
  while (clock.beginFixedStep()) {
    ++steps;
    clock.endFixedStep();
  }
  EXPECT_EQ(steps, 1'000'000);
  EXPECT_EQ(clock.fixedTime(), 1000.0F);
}

TEST(GameClock, LongFrameAdvancesByTheMaximumOnly) {
  TimeSettings settings;
  settings.fixed_delta_time_s = 0.1;
  settings.maximum_delta_time_s = 0.25;
  GameClock clock(settings);
  EXPECT_EQ(fixedTimes(clock, 1000 * kMs).size(), 2U);  // 0.1 and 0.2
  EXPECT_EQ(clock.deltaTime(), 0.25F);
  EXPECT_EQ(clock.timeNs(), 250 * kMs);
  EXPECT_EQ(fixedTimes(clock, 1060 * kMs).size(), 1U);  // 0.31 s: the lost 0.75 s stay lost
  EXPECT_EQ(clock.timeNs(), 310 * kMs);
}

TEST(GameClock, RestartSkipsStepsUpToItsTime) {
  TimeSettings settings;
  settings.fixed_delta_time_s = 0.02;
  GameClock clock(settings);
  clock.restart(100 * kMs);
  EXPECT_EQ(clock.time(), 0.1F);
  EXPECT_EQ(clock.deltaTime(), 0.0F);
  EXPECT_EQ(fixedTimes(clock, 119 * kMs), (std::vector<float>{}));
  EXPECT_EQ(fixedTimes(clock, 120 * kMs), (std::vector<float>{0.12F}));
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
  EXPECT_EQ(other.frameCount(), clock.frameCount());
  EXPECT_EQ(fixedTimes(other, 2 * 49'999'997), fixedTimes(clock, 2 * 49'999'997));
}

}  // namespace
}  // namespace sim2vr

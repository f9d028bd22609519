// SPDX-License-Identifier: Apache-2.0
// The app in lockstep. What every game must keep is in tests/contract; here is what Python cannot
// see.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/runtime/app.hpp"
#include "sim2vr/xr/frames.hpp"

namespace sim2vr::runtime {
namespace {

constexpr std::int64_t kFrameNs = 50'000'000;

std::shared_ptr<render::Renderer> nullRenderer() {
  return render::Renderer::create(render::RendererKind::null);
}

AppSettings settings(const std::string& options = R"({"condition": "medium"})") {
  AppSettings values;
  values.options_json = options;
  return values;
}

xr::DeviceState player(double hand_z) {
  xr::DeviceState state;
  state.head = xr::toXr(Pose{Vec3(0.0, 1.17, 0.0), Quat::Identity()});
  xr::ControllerState& right = state.hand(xr::Hand::right);
  right.active = true;
  right.grip = xr::toXr(Pose{Vec3(0.15, 1.03, hand_z), Quat::Identity()});
  right.aim = right.grip;
  return state;
}

/// Shakes the hammer through the middle cell with a period of 4 frames and returns the state
/// hashes.
std::vector<std::uint64_t> play(App& app, int frames) {
  std::vector<std::uint64_t> hashes;
  app.reset({.seed = 3}, player(0.2));
  for (int n = 1; n <= frames; ++n) {
    app.step({n * kFrameNs, player(n % 4 == 3 ? 0.35 : 0.2)});
    hashes.push_back(app.stateHash());
  }
  return hashes;
}

TEST(App, ImageKeepsItsAddressForLife) {
  App app(settings(), nullRenderer());
  const std::uint8_t* address = app.image().data();
  EXPECT_EQ(app.image().size(), 120U * 80U * 4U);
  play(app, 5);
  app.load(app.save());
  EXPECT_EQ(app.image().data(), address);
}

TEST(App, AppsOnDifferentThreadsPlayTheSameRound) {
  App alone(settings(), nullRenderer());
  const auto expected = play(alone, 60);
  const auto renderer = nullRenderer();
  std::vector<std::vector<std::uint64_t>> results(4);
  std::vector<std::thread> threads;
  for (auto& result : results) {
    threads.emplace_back([&result, renderer] {
      App app(settings(), renderer);
      result = play(app, 60);
    });
  }
  for (auto& thread : threads) thread.join();
  for (const auto& result : results) EXPECT_EQ(result, expected);
}

TEST(App, RefusedOptionsLeaveTheRoundRunning) {
  App app(settings(), nullRenderer());
  play(app, 10);
  const std::uint64_t before = app.stateHash();
  EXPECT_THROW(app.reset({1, R"({"condition": "nosuch"})"}, player(0.2)), InvalidArgument);
  EXPECT_THROW(app.reset({1, "[1]"}, player(0.2)), InvalidArgument);
  EXPECT_EQ(app.stateHash(), before);
  app.step({11 * kFrameNs, player(0.2)});
}

TEST(App, OptionsOfAResetStayForLaterRounds) {
  App app(settings(R"({"round_seconds": 1.0})"), nullRenderer());
  app.reset({1, R"({"round_seconds": 0.5})"}, player(0.2));
  for (int round = 0; round < 2; ++round) {
    int frames = 0;
    bool finished = false;
    while (!finished) finished = app.step({++frames * kFrameNs, player(0.2)}).finished;
    // 0.5 s is frame 10; the round ends at the first frame after it.
    EXPECT_EQ(frames, 11);
    EXPECT_THROW(app.step({12 * kFrameNs, player(0.2)}), StateError);
    app.reset({.seed = 1}, player(0.2));
  }
}

// Frames at 100 Hz: one by one, or five in a step.
TEST(App, FramesOfAStepAreFrames) {
  const std::string options =
      R"({"condition": "medium", "spawn_times": [0.5, 1.5], "spawn_cells": [4, 4]})";
  App one(settings(options), nullRenderer());
  App five(settings(options), nullRenderer());
  one.reset({.seed = 3}, player(0.2));
  five.reset({.seed = 3}, player(0.2));
  const auto hand = [](int n) { return player(n % 8 < 4 ? 0.2 : 0.36); };
  int hits = 0;
  for (int step = 0; step < 60; ++step) {
    std::vector<FrameInput> frames;
    for (int n = 5 * step + 1; n <= 5 * step + 5; ++n) {
      frames.push_back({lockstepFrameTimeNs(n, 100), hand(n)});
      one.step(frames.back());
    }
    const StepResult result = five.step(frames);
    hits = static_cast<int>(result.log.at("Points"));
    EXPECT_EQ(one.step(frames.back()).log.at("Points"), five.step(frames.back()).log.at("Points"));
  }
  EXPECT_GT(hits, 0);
}

// The reward of an event counts once, the distance term is that of one frame of 50 ms on average.
TEST(App, AStepIsWorthTheSameAtAnyTrackingRate) {
  const std::string options =
      R"({"condition": "easy", "spawn_times": [0.0], "spawn_cells": [4], "life_seconds": 100})";
  double sums[2] = {0.0, 0.0};
  for (const int rate : {1, 5}) {
    App app(settings(options), nullRenderer());
    app.reset({.seed = 3}, player(0.1));
    for (int step = 0; step < 40; ++step) {
      std::vector<FrameInput> frames;
      for (int j = 1; j <= rate; ++j) {
        frames.push_back({lockstepFrameTimeNs(rate * step + j, 20 * rate), player(0.1)});
      }
      const double reward = app.step(frames).reward;
      if (step >= 20) sums[rate / 5] += reward;
    }
  }
  EXPECT_LT(sums[0], -0.5);
  EXPECT_NEAR(sums[1], sums[0], 1e-5);
}

TEST(App, AStepEndsWithTheRound) {
  App app(settings(R"({"round_seconds": 0.5})"), nullRenderer());
  app.reset({.seed = 1}, player(0.2));
  std::vector<FrameInput> frames;
  for (int n = 1; n <= 20; ++n) frames.push_back({n * kFrameNs, player(0.2)});
  const StepResult result = app.step(frames);
  EXPECT_TRUE(result.finished);
  // Frame 11 is the first after 0.5 s; the other nine were not run.
  App single(settings(R"({"round_seconds": 0.5})"), nullRenderer());
  single.reset({.seed = 1}, player(0.2));
  StepResult last;
  for (int n = 1; n <= 11; ++n) last = single.step({n * kFrameNs, player(0.2)});
  EXPECT_EQ(result.time_feature, last.time_feature);
}

// A step of 10,000 frames is not waited for when the process is asked to end.
TEST(App, IsAskedToEndBetweenTheFramesOfAStep) {
  App app(settings(), nullRenderer());
  std::atomic<bool> stop = false;
  app.stopOn(&stop);
  app.reset({.seed = 3}, player(0.2));
  const std::vector<FrameInput> frames{{kFrameNs, player(0.2)}, {2 * kFrameNs, player(0.2)}};
  app.startStep(frames, 0);
  const std::uint64_t after_one = app.stateHash();
  stop = true;
  EXPECT_THROW(app.finishStep(), Interrupted);
  EXPECT_EQ(app.stateHash(), after_one) << "no frame was run";
  EXPECT_THROW(app.reset({.seed = 3}, player(0.2)), Interrupted);
  EXPECT_EQ(app.stateHash(), after_one);
  stop = false;
  EXPECT_EQ(play(app, 4), [] {
    App other(settings(), nullRenderer());
    return play(other, 4);
  }());
}

TEST(App, ARefusedFrameLeavesTheRoundAsItWas) {
  App app(settings(), nullRenderer());
  play(app, 10);
  const std::uint64_t before = app.stateHash();
  xr::DeviceState broken = player(0.2);
  broken.head.position.x = std::nanf("");
  const std::vector<FrameInput> not_finite{{11 * kFrameNs, player(0.2)}, {12 * kFrameNs, broken}};
  EXPECT_THROW(app.step(not_finite), InvalidArgument);
  const std::vector<FrameInput> backwards{{12 * kFrameNs, player(0.2)},
                                          {11 * kFrameNs, player(0.2)}};
  EXPECT_THROW(app.step(backwards), InvalidArgument);
  EXPECT_THROW(app.step(std::span<const FrameInput>{}), InvalidArgument);
  EXPECT_THROW(app.reset({.time_ns = -1}, player(0.2)), InvalidArgument);
  EXPECT_EQ(app.stateHash(), before);
}

// Fixed steps lie on the absolute grid: from 1000.0005 s the next is 1000.002 s.
TEST(App, ARoundMayBeginAnywhereOnTheClock) {
  App app(settings(R"({"condition": "easy", "spawn_times": [1000.01], "spawn_cells": [4],
                       "condition": "easy-unconstrained"})"),
          nullRenderer());
  constexpr std::int64_t start = 1'000'000'500'000;
  app.reset({.seed = 1, .time_ns = start}, player(0.0));
  StepResult result;
  int frames = 0;
  while (result.log["Misses"] < 1.0) result = app.step({start + ++frames * kFrameNs, player(0.0)});
  // Spawned at 1000.0505 s (fixed time 1000.05), over at 1001.15 s, seen in the frame at 1001.1505.
  EXPECT_EQ(frames, 23);
  EXPECT_THROW(app.step({5 * kFrameNs, player(0.0)}), InvalidArgument);
}

TEST(App, ViewNames) {
  EXPECT_EQ(viewFromName("spectator"), View::spectator);
  try {
    viewFromName("spektator");
    FAIL() << "no error";
  } catch (const InvalidArgument& error) {
    EXPECT_STREQ(error.what(),
                 "view: got 'spektator', expected one of 'headset', 'recorder' or 'spectator'; did "
                 "you mean 'spectator'?");
  }
}

TEST(App, LoadingADamagedStateLeavesAnAppThatCanBeReset) {
  App app(settings(), nullRenderer());
  const auto expected = play(app, 20);
  std::string saved = app.save();
  saved.resize(saved.size() / 2);
  EXPECT_THROW(app.load(saved), EngineError);
  EXPECT_THROW(app.step({21 * kFrameNs, player(0.2)}), StateError);
  EXPECT_EQ(play(app, 20), expected);
}

TEST(App, ASavedStateWithOptionsThatCannotBeIsADamagedOne) {
  App app(settings(), nullRenderer());
  play(app, 5);
  std::string saved = app.save();
  const std::size_t place = saved.find("medium");
  ASSERT_NE(place, std::string::npos);
  saved.replace(place, 6, "meduim");
  try {
    app.load(saved);
    FAIL() << "no error";
  } catch (const EngineError& error) {
    EXPECT_EQ(std::string(error.what()).find("saved state: option 'condition': got 'meduim'"), 0U);
  }
}

}  // namespace
}  // namespace sim2vr::runtime

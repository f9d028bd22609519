// The app in lockstep. What every game must keep is in tests/contract; here is what Python cannot
// see.
#include <gtest/gtest.h>

#include <algorithm>
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

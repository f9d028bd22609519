// SPDX-License-Identifier: Apache-2.0
// Many apps together: each plays as it would alone, to the bit, whatever the company and threads.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "own_folder.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/runtime/app.hpp"
#include "sim2vr/runtime/app_batch.hpp"
#include "sim2vr/xr/pose_row.hpp"

namespace sim2vr::runtime {
namespace {

BatchSettings settings(int apps, int threads,
                       render::RendererKind renderer = render::RendererKind::null) {
  BatchSettings values;
  values.app.options_json = R"({"condition": "hard", "round_seconds": 4})";
  values.apps = apps;
  values.threads = threads;
  values.renderer = renderer;
  return values;
}

/// A hammer that swings at the area, differently for every player.
xr::DeviceState player(int seed, int frame) {
  const double t = 0.05 * frame + 0.7 * seed;
  const double head[7] = {0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0};
  const double right[7] = {0.15 + 0.12 * std::sin(1.3 * t),
                           1.03 + 0.12 * std::cos(0.9 * t),
                           0.24 + 0.14 * std::sin(9.0 * t),
                           0.0,
                           0.0,
                           0.0,
                           1.0};
  return xr::devicesFromRows(head, nullptr, right);
}

struct Track {
  std::vector<std::uint64_t> states;
  std::vector<float> rewards;
  std::vector<std::vector<std::uint8_t>> images;

  bool operator==(const Track&) const = default;
};

constexpr int kFrames = 60;

/// The player's round in an app of its own.
Track alone(int seed, render::RendererKind kind) {
  App app(settings(1, 1).app, render::Renderer::create(kind));
  Track track;
  app.reset({.seed = static_cast<std::uint32_t>(seed)}, player(seed, 0));
  for (int frame = 1; frame <= kFrames; ++frame) {
    const StepResult result = app.step({lockstepFrameTimeNs(frame, 20), player(seed, frame)});
    track.states.push_back(app.stateHash());
    track.rewards.push_back(result.reward);
    track.images.emplace_back(app.image().begin(), app.image().end());
  }
  return track;
}

/// The rounds of players `seeds` in a batch, app i playing seeds[i]; `renderer`: instead of those
/// that the batch makes.
std::vector<Track> together(const std::vector<int>& seeds, int threads, render::RendererKind kind,
                            std::shared_ptr<render::Renderer> renderer = nullptr) {
  BatchSettings values = settings(static_cast<int>(seeds.size()), threads, kind);
  if (renderer != nullptr) values.renderers.push_back(std::move(renderer));
  AppBatch batch(values);
  std::vector<int> indices;
  std::vector<RoundStart> starts;
  std::vector<xr::DeviceState> devices;
  for (std::size_t i = 0; i < seeds.size(); ++i) {
    indices.push_back(static_cast<int>(i));
    starts.push_back({.seed = static_cast<std::uint32_t>(seeds[i])});
    devices.push_back(player(seeds[i], 0));
  }
  batch.reset(indices, starts, devices);
  std::vector<Track> tracks(seeds.size());
  const std::size_t bytes = batch.images().size() / seeds.size();
  for (int frame = 1; frame <= kFrames; ++frame) {
    std::vector<FrameInput> frames;
    for (const int seed : seeds) {
      frames.push_back({lockstepFrameTimeNs(frame, 20), player(seed, frame)});
    }
    batch.step(indices, frames);
    for (std::size_t i = 0; i < seeds.size(); ++i) {
      tracks[i].states.push_back(batch.app(static_cast<int>(i)).stateHash());
      tracks[i].rewards.push_back(batch.rewards()[i]);
      const auto image = batch.images().subspan(i * bytes, bytes);
      tracks[i].images.emplace_back(image.begin(), image.end());
    }
  }
  return tracks;
}

/// Draws as another renderer does, but says that a GPU does it; counts its calls.
class Gpu final : public render::Renderer {
 public:
  render::RendererKind kind() const override { return real_->kind(); }
  const std::string& description() const override { return real_->description(); }
  bool drawsOnCpu() const override { return false; }
  void renderBatch(std::span<const render::ViewRequest> requests) override {
    ++calls;
    views += requests.size();
    real_->renderBatch(requests);
  }

  int calls = 0;
  std::size_t views = 0;

 private:
  std::shared_ptr<render::Renderer> real_ =
      render::Renderer::create(render::RendererKind::automatic);
};

TEST(AppBatch, EveryAppPlaysAsAloneWhateverTheCompanyAndThreads) {
  for (const auto kind : {render::RendererKind::null, render::RendererKind::automatic}) {
    std::vector<Track> expected;
    for (int seed = 0; seed < 5; ++seed) expected.push_back(alone(seed, kind));
    for (const int threads : {1, 2, 3, 8}) {
      EXPECT_TRUE(together({0, 1, 2, 3, 4}, threads, kind) == expected) << threads << " threads";
    }
    const auto mixed = together({3, 3, 1}, 2, kind);
    EXPECT_TRUE(mixed[0] == expected[3]);
    EXPECT_TRUE(mixed[1] == expected[3]);
    EXPECT_TRUE(mixed[2] == expected[1]);
  }
}

TEST(AppBatch, AGpuDrawsAllAppsInOneTurnWhateverTheThreads) {
  std::vector<Track> expected;
  for (int seed = 0; seed < 5; ++seed) {
    expected.push_back(alone(seed, render::RendererKind::automatic));
  }
  for (const int threads : {1, 3}) {
    const auto gpu = std::make_shared<Gpu>();
    // A null renderer beside it would leave black pictures.
    EXPECT_TRUE(together({0, 1, 2, 3, 4}, threads, render::RendererKind::null, gpu) == expected);
    EXPECT_EQ(gpu->calls, 1 + kFrames) << threads << " threads";
    EXPECT_EQ(gpu->views, 5U * (1 + kFrames));
  }
}

TEST(AppBatch, VisionHoldsTheChosenChannelsOfTheImages) {
  BatchSettings values = settings(3, 2, render::RendererKind::automatic);
  values.vision_channels = {3, 1};
  AppBatch batch(values);
  const auto expectSeparated = [&batch](int app) {
    const std::size_t pixels = batch.images().size() / 3 / 4;
    const auto image = batch.images().subspan(app * pixels * 4, pixels * 4);
    const auto planes = batch.vision().subspan(app * pixels * 2, pixels * 2);
    for (std::size_t i = 0; i < pixels; ++i) {
      ASSERT_EQ(planes[i], image[4 * i + 3]);
      ASSERT_EQ(planes[pixels + i], image[4 * i + 1]);
    }
  };
  const std::vector<int> all{0, 1, 2};
  batch.reset(all, std::vector<RoundStart>(3), std::vector<xr::DeviceState>(3, player(0, 0)));
  const std::string start = batch.app(1).save();
  const std::vector<std::uint8_t> first(batch.vision().begin(), batch.vision().end());
  const std::vector<double> logs(batch.logs().begin(), batch.logs().end());
  std::vector<FrameInput> frames;
  for (int app = 0; app < 3; ++app) frames.push_back({50'000'000, player(app, 1)});
  batch.step(all, frames);
  for (const int app : all) expectSeparated(app);
  EXPECT_FALSE(std::equal(first.begin(), first.end(), batch.vision().begin()));
  batch.load(1, start);
  expectSeparated(1);
  const std::size_t bytes = first.size() / 3;
  EXPECT_TRUE(std::equal(first.begin() + bytes, first.begin() + 2 * bytes,
                         batch.vision().subspan(bytes).begin()));
  const std::size_t numbers = batch.logNames().size();
  const auto expectLog = [&](int app, bool as_at_the_start) {
    const auto row = batch.logs().subspan(app * numbers, numbers);
    EXPECT_EQ(std::equal(row.begin(), row.end(), logs.begin() + app * numbers), as_at_the_start);
  };
  expectLog(0, false);
  expectLog(1, true);
  values.vision_channels = {4};
  EXPECT_THROW(AppBatch{values}, InvalidArgument);
}

TEST(AppBatch, OnlyTheGivenAppsMove) {
  AppBatch batch(settings(3, 2));
  const std::vector<int> all{0, 1, 2};
  batch.reset(all, std::vector<RoundStart>(3), std::vector<xr::DeviceState>(3, player(0, 0)));
  const std::uint64_t before = batch.app(1).stateHash();
  const std::vector<int> some{2, 0};
  const std::vector<FrameInput> frames{{50'000'000, player(2, 1)}, {50'000'000, player(0, 1)}};
  batch.step(some, frames);
  EXPECT_EQ(batch.app(1).stateHash(), before);
  EXPECT_NE(batch.app(0).stateHash(), before);
}

TEST(AppBatch, ResultsKeepTheirAddress) {
  AppBatch batch(settings(2, 2));
  const std::vector<int> all{0, 1};
  batch.reset(all, std::vector<RoundStart>(2), std::vector<xr::DeviceState>(2, player(0, 0)));
  const void* before[] = {batch.images().data(), batch.rewards().data(), batch.logs().data()};
  const std::vector<FrameInput> frames(2, {50'000'000, player(1, 1)});
  batch.step(all, frames);
  batch.app(1).load(batch.app(0).save());
  const void* after[] = {batch.images().data(), batch.rewards().data(), batch.logs().data()};
  EXPECT_TRUE(std::equal(std::begin(before), std::end(before), after));
  // App 1 draws into its own row.
  EXPECT_EQ(batch.app(1).image().data(), batch.images().data() + batch.images().size() / 2);
  const auto points = std::find(batch.logNames().begin(), batch.logNames().end(), "Points");
  ASSERT_NE(points, batch.logNames().end());
  EXPECT_EQ(batch.logs().size(), 2 * batch.logNames().size());
}

TEST(AppBatch, AFailingAppIsNamedAndTheOthersMove) {
  AppBatch batch(settings(3, 2));
  const std::vector<int> all{0, 1, 2};
  batch.reset(all, std::vector<RoundStart>(3), std::vector<xr::DeviceState>(3, player(0, 0)));
  std::vector<FrameInput> frames(3, {50'000'000, player(1, 1)});
  frames[1].devices.head.position.x = std::nanf("");
  const std::uint64_t before = batch.app(1).stateHash();
  try {
    batch.step(all, frames);
    FAIL() << "nothing was thrown";
  } catch (const InvalidArgument& error) {
    EXPECT_EQ(error.field(), "app 1, head.position");
  }
  EXPECT_EQ(batch.app(1).stateHash(), before);
  EXPECT_NE(batch.app(0).stateHash(), before);
  EXPECT_EQ(batch.app(0).stateHash(), batch.app(2).stateHash());

  AppBatch fresh(settings(2, 2));
  const std::vector<int> one{1};
  const std::vector<FrameInput> frame{{50'000'000, player(1, 1)}};
  try {
    fresh.step(one, frame);
    FAIL() << "nothing was thrown";
  } catch (const StateError& error) {
    EXPECT_STREQ(error.what(), "app 1: step: no round was started; call reset first");
  }
}

TEST(AppBatch, RefusesImpossibleShapes) {
  const auto errorOf = [](const auto& call) -> std::string {
    try {
      call();
    } catch (const InvalidArgument& error) {
      return error.what();
    }
    return "none";
  };
  EXPECT_EQ(errorOf([] { AppBatch(settings(0, 1)); }), "apps: got 0, expected 1 or more");
  EXPECT_EQ(errorOf([] { AppBatch(settings(1, 0)); }), "threads: got 0, expected 1 or more");
  AppBatch batch(settings(2, 4));
  EXPECT_EQ(batch.threads(), 2);
  const std::vector<int> wrong{2};
  EXPECT_EQ(errorOf([&] { batch.step(wrong, std::vector<FrameInput>(1)); }),
            "app: got 2, expected 0 to 1");
  const std::vector<int> all{0, 1};
  EXPECT_EQ(errorOf([&] { batch.step(all, std::vector<FrameInput>(3)); }),
            "frames: got 3, expected a multiple of the 2 apps");
}

TEST(AppBatch, EveryAppHasALogFolder) {
  const sim2vr::testing::OwnFolder root;
  {
    BatchSettings logged = settings(2, 2);
    logged.log_dirs = {root / "user000", root / "user001"};
    AppBatch batch(logged);
    const std::vector<int> all{0, 1};
    batch.reset(all, std::vector<RoundStart>(2), std::vector<xr::DeviceState>(2, player(0, 0)));
  }
  EXPECT_TRUE(std::filesystem::exists(root / "user000" / "0000-hard" / "states.csv"));
  EXPECT_TRUE(std::filesystem::exists(root / "user001" / "0000-hard" / "states.csv"));
}

}  // namespace
}  // namespace sim2vr::runtime

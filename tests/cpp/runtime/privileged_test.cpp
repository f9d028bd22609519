// SPDX-License-Identifier: Apache-2.0
// Privileged numbers on their way from a game to a batch of apps.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/runtime/app.hpp"
#include "sim2vr/runtime/app_batch.hpp"
#include "sim2vr/xr/pose_row.hpp"

namespace sim2vr::runtime {
namespace {

BatchSettings settings(const char* game, int apps, int threads) {
  BatchSettings values;
  values.app.game = game;
  values.apps = apps;
  values.threads = threads;
  values.renderer = render::RendererKind::null;
  return values;
}

xr::DeviceState player(int number, int frame) {
  const double head[7] = {0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0};
  const double right[7] = {0.15 + 0.01 * number, 1.0, 0.2 + 0.01 * frame, 0.0, 0.0, 0.0, 1.0};
  return xr::devicesFromRows(head, nullptr, right);
}

std::vector<float> observed(LockstepApp& app) {
  std::vector<float> values(app.privilegedNames().size());
  app.fillPrivileged(values);
  return values;
}

TEST(Privileged, ABatchHoldsWhatEveryAppSaysAfterItsLastFrame) {
  for (const int threads : {1, 2}) {
    AppBatch batch(settings("whacamole", 3, threads));
    const std::size_t width = batch.privilegedNames().size();
    ASSERT_EQ(batch.privileged().size(), 3 * width);
    const void* address = batch.privileged().data();
    const std::vector<int> all{0, 1, 2};
    batch.reset(all, std::vector<RoundStart>(3),
                {std::vector{player(0, 0), player(1, 0), player(2, 0)}});
    for (int step = 0; step < 20; ++step) {
      std::vector<FrameInput> frames;
      for (const int app : all) {
        for (int k = 1; k <= 5; ++k) {
          const int frame = 5 * step + k;
          frames.push_back({lockstepFrameTimeNs(frame, 100), player(app, frame)});
        }
      }
      batch.step(all, frames);
      for (const int app : all) {
        const auto row = batch.privileged().subspan(static_cast<std::size_t>(app) * width, width);
        EXPECT_TRUE(std::ranges::equal(row, observed(batch.app(app)))) << app;
      }
    }
    EXPECT_EQ(batch.privileged().data(), address);
    const auto x = std::ranges::find(batch.privilegedNames(), "hammer.x_m");
    ASSERT_NE(x, batch.privilegedNames().end());
    const auto column = static_cast<std::size_t>(x - batch.privilegedNames().begin());
    EXPECT_NEAR(batch.privileged()[2 * width + column] - batch.privileged()[column], 0.02, 1e-6);
    // 1 cm in each frame of 10 ms, not in each step.
    EXPECT_NEAR(batch.privileged()[column + 5], 1.0, 1e-3);
  }
}

TEST(Privileged, WhatThePictureShowsIsAsOldAsThePicture) {
  AppBatch batch(settings("whacamole", 1, 1));
  const std::vector<int> all{0};
  batch.reset(all, std::vector<RoundStart>(1), {std::vector{player(0, 0)}});
  const auto names = batch.privilegedNames();
  const auto z = static_cast<std::size_t>(std::ranges::find(names, "hammer.z_m") - names.begin());
  EXPECT_EQ(batch.privilegedDrawn()[z], batch.privileged()[z]);
  const auto step = [&](int number, int drawn) {
    std::vector<FrameInput> frames;
    for (int k = 1; k <= 5; ++k) {
      const int frame = 5 * number + k;
      frames.push_back({lockstepFrameTimeNs(frame, 100), player(0, frame)});
    }
    batch.step(all, frames, drawn);
  };
  // The hammer moves by 1 cm in each frame, and three frames come after the one that is drawn.
  step(0, 1);
  EXPECT_NEAR(batch.privileged()[z] - batch.privilegedDrawn()[z], 0.03, 1e-6);
  step(1, kLastFrame);
  EXPECT_EQ(batch.privilegedDrawn()[z], batch.privileged()[z]);
}

TEST(Privileged, AGameMayHaveNone) {
  AppBatch batch(settings("sample", 2, 1));
  EXPECT_TRUE(batch.privilegedNames().empty());
  EXPECT_TRUE(batch.privileged().empty());
  const std::vector<int> all{0, 1};
  EXPECT_NO_THROW(
      batch.reset(all, std::vector<RoundStart>(2), {std::vector{player(0, 0), player(1, 0)}}));
}

TEST(Privileged, RefusesOtherSizesAndAnAppWithoutARound) {
  App app(settings("whacamole", 1, 1).app, render::Renderer::create(render::RendererKind::null));
  std::vector<float> values(app.privilegedNames().size());
  EXPECT_THROW(app.fillPrivileged(values), StateError);
  values.pop_back();
  EXPECT_THROW(app.fillPrivileged(values), InvalidArgument);
}

}  // namespace
}  // namespace sim2vr::runtime

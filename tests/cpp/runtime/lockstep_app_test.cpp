// SPDX-License-Identifier: Apache-2.0
// The seam below server and batch, proved by an app that is none of the runtime's.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "error_of.hpp"
#include "own_loop.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/runtime/app.hpp"
#include "sim2vr/runtime/app_batch.hpp"

namespace sim2vr::runtime {
namespace {

using testing::OwnLoop;

constexpr std::int64_t kFrameNs = 50'000'000;

xr::DeviceState player(float height_m, float trigger = 0.0F) {
  xr::DeviceState state;
  state.head.position.y = height_m;
  state.hand(xr::Hand::right).active = true;
  state.hand(xr::Hand::right).trigger = trigger;
  return state;
}

BatchSettings batchOf(int apps, const AppFactory& make) {
  BatchSettings settings;
  settings.app.headset_size = {4, 2};
  settings.apps = apps;
  settings.threads = 2;
  settings.renderer = render::RendererKind::null;
  settings.vision_channels = {3};
  settings.make = make;
  return settings;
}

TEST(LockstepApp, ABatchPlaysAnAppWithALoopOfItsOwn) {
  AppBatch batch(batchOf(3, OwnLoop::factory({Capability::frames, Capability::inputs})));
  const std::vector<int> all{0, 1, 2};
  batch.reset(all, {std::vector<RoundStart>{{.seed = 10}, {.seed = 20}, {.seed = 30}}},
              std::vector<xr::DeviceState>(3, player(1.5F)));
  EXPECT_EQ(batch.images()[0], 10);
  EXPECT_EQ(batch.images()[2 * 4 * 2 * 4], 30);
  std::vector<FrameInput> frames;
  for (int app = 0; app < 3; ++app) {
    for (int k = 1; k <= 4; ++k)
      frames.push_back({k * kFrameNs, player(0.25F * static_cast<float>(k))});
  }
  batch.step(all, frames, 1);
  // Frame 1 of 0 .. 3 is drawn, all four count: 0.25 + 0.5 + 0.75 + 1.
  EXPECT_EQ(batch.images()[0], 12);
  EXPECT_EQ(batch.vision()[4 * 2], 22);
  EXPECT_FLOAT_EQ(batch.rewards()[1], 2.5F);
  EXPECT_EQ(batch.logNames(), std::vector<std::string>{"Frames"});
  EXPECT_EQ(batch.logs()[2], 34.0);
  EXPECT_EQ(batch.app(0).rendererDescription(), "paints grey");
}

TEST(LockstepApp, WhatAnAppCannotIsRefusedByItsName) {
  AppSettings settings;
  const auto app = OwnLoop::factory()(settings, nullptr, {});
  app->reset({.seed = 1}, player(1.0F));
  const auto unsupported = [&](const auto& call) {
    try {
      call();
    } catch (const Unsupported& error) {
      return std::string(capabilityName(error.capability()));
    }
    return std::string("none");
  };
  EXPECT_EQ(unsupported([&] { app->save(); }), "save");
  EXPECT_EQ(unsupported([&] { app->load(""); }), "save");
  EXPECT_EQ(unsupported([&] { app->stateHash(); }), "save");
  EXPECT_EQ(unsupported([&] { app->headRequest({}); }), "head_request");
  EXPECT_EQ(unsupported([&] { app->renderView(View::headset, {1, 1}, {}); }), "views");
  EXPECT_EQ(unsupported([&] { app->fillPrivileged({}); }), "privileged");
  EXPECT_EQ(unsupported([&] { app->step({kFrameNs, player(1.0F, 0.5F)}); }), "inputs");
  xr::DeviceState left = player(1.0F);
  left.hand(xr::Hand::left).active = true;
  EXPECT_EQ(unsupported([&] { app->step({kFrameNs, left}); }), "left_controller");
  EXPECT_EQ(unsupported([&] { app->reset({.seed = 1}, left); }), "left_controller");
  const std::vector<FrameInput> two(2, {kFrameNs, player(1.0F)});
  EXPECT_EQ(unsupported([&] { app->step(two); }), "frames");
  settings.eyes = 2;
  EXPECT_EQ(unsupported([&] { OwnLoop::factory()(settings, nullptr, {}); }), "two_eyes");
  // Nothing has moved.
  EXPECT_EQ(app->log().at("Frames"), 1.0);
  EXPECT_EQ(errorOf<std::exception>([&] { app->save(); }),
            "save: the app does not have this capability");
}

TEST(LockstepApp, EventsComeBackWithTheStepTheyBelongTo) {
  const auto app = OwnLoop::factory({Capability::inputs, Capability::haptics})({}, nullptr, {});
  EXPECT_TRUE(app->reset({}, player(1.0F)).events.haptics.empty());
  const StepResult result = app->step({kFrameNs, player(1.0F, 0.5F)});
  ASSERT_EQ(result.events.haptics.size(), 1U);
  EXPECT_EQ(result.events.haptics[0].amplitude, 0.5F);
  EXPECT_TRUE(app->step({2 * kFrameNs, player(1.0F)}).events.haptics.empty());
}

TEST(LockstepApp, TheGamesAppHasEveryCapabilityItsGameHas) {
  AppSettings settings;
  const auto renderer = render::Renderer::create(render::RendererKind::null);
  EXPECT_EQ(gameApps()(settings, renderer, {})->capabilities().size(), 12U);
  settings.game = "sample";
  const auto sample = gameApps()(settings, renderer, {});
  EXPECT_EQ(sample->capabilities().size(), 11U);
  EXPECT_FALSE(sample->can(Capability::privileged));
}

TEST(LockstepApp, AStepHasTwoHalvesInTheirOrder) {
  App app({}, render::Renderer::create(render::RendererKind::null));
  EXPECT_EQ(errorOf<std::exception>([&] { app.finishStep(); }),
            "finishStep: no round was started; call reset first");
  app.reset({.seed = 1}, player(1.0F));
  EXPECT_EQ(errorOf<std::exception>([&] { app.finishStep(); }),
            "finishStep: no step was started; call startStep first");
  const std::vector<FrameInput> frames(2, {kFrameNs, player(1.0F)});
  EXPECT_EQ(errorOf<std::exception>([&] { app.startStep(frames, 2); }),
            "drawn: got 2, expected 0 to 1, or -1 for the last frame");
  app.startStep(frames);
  EXPECT_EQ(errorOf<std::exception>([&] { app.startStep(frames); }),
            "step: one was started already; finish it first");
  app.finishStep();
}

}  // namespace
}  // namespace sim2vr::runtime

// SPDX-License-Identifier: Apache-2.0
// Inputs on their way to a game, and pulses and sounds on their way back.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "drum.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/runtime/app_batch.hpp"

namespace sim2vr::runtime {
namespace {

using testing::drummer;
using testing::drums;

constexpr std::int64_t kFrameNs = 50'000'000;

std::unique_ptr<LockstepApp> drum() {
  return drums()({}, render::Renderer::create(render::RendererKind::null), {});
}

void expectBeats(const Events& events, const std::vector<xr::Hand>& hands) {
  ASSERT_EQ(events.haptics.size(), hands.size());
  ASSERT_EQ(events.sounds.size(), hands.size());
  for (std::size_t i = 0; i < hands.size(); ++i) {
    EXPECT_EQ(events.haptics[i].hand, hands[i]);
    EXPECT_EQ(events.haptics[i].amplitude, 0.25F);
    EXPECT_EQ(events.haptics[i].frequency_hz, 80.0F);
    EXPECT_EQ(events.haptics[i].duration_ns, 30'000'000);
    EXPECT_EQ(events.sounds[i].name, "drum");
    EXPECT_EQ(events.sounds[i].position_m, Vec3(0.0, 1.0, 1.0));
    EXPECT_EQ(events.sounds[i].gain, 0.5F);
  }
}

TEST(Events, APullOfATriggerIsFeltAndHeardInItsOwnStepOnly) {
  const auto app = drum();
  expectBeats(app->reset({}, drummer(0.0F, 0.0F)).events, {});
  expectBeats(app->step({kFrameNs, drummer(0.0F, 1.0F)}).events, {xr::Hand::right});
  // Held: no beat.
  expectBeats(app->step({2 * kFrameNs, drummer(0.0F, 1.0F)}).events, {});
  expectBeats(app->step({3 * kFrameNs, drummer(1.0F, 0.0F)}).events, {xr::Hand::left});
  const StepResult both = app->step(std::vector<FrameInput>{{4 * kFrameNs, drummer(0.0F, 0.0F)},
                                                            {5 * kFrameNs, drummer(1.0F, 0.0F)},
                                                            {6 * kFrameNs, drummer(1.0F, 1.0F)}});
  expectBeats(both.events, {xr::Hand::left, xr::Hand::right});
  EXPECT_EQ(both.reward, 2.0F);
  EXPECT_EQ(both.log.at("Beats"), 4.0);
}

TEST(Events, AHeldTriggerIsPartOfASavedRound) {
  const auto app = drum();
  const auto other = drum();
  app->reset({}, drummer(0.0F, 0.0F));
  app->step({kFrameNs, drummer(0.0F, 1.0F)});
  other->load(app->save());
  EXPECT_TRUE(other->events().haptics.empty());
  EXPECT_EQ(other->stateHash(), app->stateHash());
  // Still held, so there is no new pull; then a new one.
  expectBeats(other->step({2 * kFrameNs, drummer(0.0F, 1.0F)}).events, {});
  expectBeats(other->step({3 * kFrameNs, drummer(0.0F, 0.0F)}).events, {});
  expectBeats(other->step({4 * kFrameNs, drummer(0.0F, 1.0F)}).events, {xr::Hand::right});
}

TEST(Events, ABatchCountsThemAndKeepsThemApart) {
  BatchSettings settings;
  settings.apps = 3;
  settings.threads = 2;
  settings.renderer = render::RendererKind::null;
  settings.make = drums();
  AppBatch batch(settings);
  const std::vector<int> all{0, 1, 2};
  batch.reset(all, std::vector<RoundStart>(3), std::vector(3, drummer(0.0F, 0.0F)));
  const void* counts = batch.hapticCounts().data();
  batch.step(all, std::vector<FrameInput>{{kFrameNs, drummer(0.0F, 0.0F)},
                                          {kFrameNs, drummer(1.0F, 1.0F)},
                                          {kFrameNs, drummer(0.0F, 1.0F)}});
  EXPECT_TRUE(std::ranges::equal(batch.hapticCounts(), std::vector{0, 2, 1}));
  EXPECT_TRUE(std::ranges::equal(batch.soundCounts(), std::vector{0, 2, 1}));
  expectBeats(batch.app(1).events(), {xr::Hand::left, xr::Hand::right});
  batch.load(2, batch.app(0).save());
  EXPECT_TRUE(std::ranges::equal(batch.hapticCounts(), std::vector{0, 2, 0}));
  EXPECT_EQ(batch.hapticCounts().data(), counts);
}

TEST(Events, InputsOutOfTheirRangeMoveNothing) {
  const auto app = drum();
  app->reset({}, drummer(0.0F, 0.0F));
  const std::uint64_t before = app->stateHash();
  EXPECT_THROW(app->step({kFrameNs, drummer(1.5F, 0.0F)}), InvalidArgument);
  EXPECT_EQ(app->stateHash(), before);
}

}  // namespace
}  // namespace sim2vr::runtime

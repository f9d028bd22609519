// SPDX-License-Identifier: Apache-2.0
// What is drawn: of which eye, and of which frame of a step.
#include <gtest/gtest.h>

#include <vector>

#include "drum.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/runtime/app_batch.hpp"

namespace sim2vr::runtime {
namespace {

using testing::drummer;
using testing::drums;

constexpr std::int64_t kFrameNs = 50'000'000;
constexpr render::ImageSize kSize{240, 160};

BatchSettings oneDrum(int eyes, double ball_m) {
  BatchSettings settings;
  settings.app.options_json = "{\"ball_m\": " + std::to_string(ball_m) + "}";
  settings.app.headset_size = kSize;
  settings.app.eyes = eyes;
  settings.app.ipd_m = 0.1F;
  settings.make = drums();
  settings.vision_channels = {0, 3};
  return settings;
}

void start(AppBatch& batch) {
  const std::vector<int> one{0};
  batch.reset(one, std::vector<RoundStart>(1), std::vector(1, drummer(0.0F, 0.0F)));
}

/// Middle of the white ball before black, pixels; x to the right, y down.
struct Middle {
  double x = 0.0, y = 0.0;
};

Middle ballIn(std::span<const std::uint8_t> rgba) {
  Middle sum;
  int pixels = 0;
  for (int y = 0; y < kSize.height; ++y) {
    for (int x = 0; x < kSize.width; ++x) {
      if (rgba[4 * static_cast<std::size_t>(y * kSize.width + x)] < 128) continue;
      sum.x += x + 0.5;
      sum.y += y + 0.5;
      ++pixels;
    }
  }
  EXPECT_GT(pixels, 10);
  return {sum.x / pixels, sum.y / pixels};
}

// 90 degrees over 160 rows: f = 80 / tan(45 degrees) = 80 pixels. Eyes 0.1 m apart see a point at
// depth d shifted by f * 0.1 / d: 8 pixels at 1 m, 4 at 2 m, 16 at 0.5 m, half of it each way.
TEST(TwoEyes, TheDisparityOfAPointIsThatOfItsDepth) {
  for (const double depth_m : {0.5, 1.0, 2.0}) {
    AppBatch batch(oneDrum(2, depth_m));
    start(batch);
    const std::size_t bytes = kSize.pixels() * 4;
    ASSERT_EQ(batch.images().size(), 2 * bytes);
    const Middle left = ballIn(batch.images().subspan(0, bytes));
    const Middle right = ballIn(batch.images().subspan(bytes, bytes));
    const double shift = 80.0 * 0.1 / depth_m;
    EXPECT_NEAR(left.x - right.x, shift, 0.15) << depth_m;
    EXPECT_NEAR(left.x, 120.0 + shift / 2.0, 0.15) << depth_m;
    EXPECT_NEAR(left.y, 80.0, 0.1);
    EXPECT_NEAR(right.y, 80.0, 0.1);
  }
}

TEST(TwoEyes, VisionHasTheLeftEyesChannelsFirst) {
  AppBatch batch(oneDrum(2, 1.0));
  start(batch);
  const std::size_t pixels = kSize.pixels();
  ASSERT_EQ(batch.vision().size(), 4 * pixels);
  for (std::size_t eye = 0; eye < 2; ++eye) {
    const auto image = batch.images().subspan(eye * pixels * 4, pixels * 4);
    const auto planes = batch.vision().subspan(eye * pixels * 2, pixels * 2);
    for (std::size_t i = 0; i < pixels; ++i) {
      ASSERT_EQ(planes[i], image[4 * i]);
      ASSERT_EQ(planes[pixels + i], image[4 * i + 3]);
    }
  }
}

TEST(TwoEyes, WithoutDistanceBothSeeWhatOneSees) {
  BatchSettings together = oneDrum(2, 1.0);
  together.app.ipd_m = 0.0F;
  AppBatch two(together);
  AppBatch one(oneDrum(1, 1.0));
  start(two);
  start(one);
  const std::size_t bytes = kSize.pixels() * 4;
  for (std::size_t eye = 0; eye < 2; ++eye) {
    EXPECT_TRUE(std::ranges::equal(two.images().subspan(eye * bytes, bytes), one.images()));
  }
}

TEST(TwoEyes, AreOneOrTwo) {
  BatchSettings settings = oneDrum(3, 1.0);
  EXPECT_THROW(AppBatch{settings}, InvalidArgument);
  settings.app.eyes = 2;
  settings.app.ipd_m = 0.3F;
  EXPECT_THROW(AppBatch{settings}, InvalidArgument);
}

// A head that turns over three frames, in one step: the picture is that of the chosen frame, and
// all else is the same.
TEST(DrawnFrame, IsThePictureOfItsOwnMoment) {
  const auto turned = [](int k) {
    xr::DeviceState state = drummer(0.0F, k == 1 ? 1.0F : 0.0F);
    const float half = 0.05F * static_cast<float>(k);
    state.head.orientation = {0.0F, std::sin(half), 0.0F, std::cos(half)};
    return state;
  };
  const std::vector<int> only{0};
  AppBatch single(oneDrum(1, 1.0));
  start(single);
  std::vector<std::vector<std::uint8_t>> pictures;
  std::vector<FrameInput> frames;
  for (int k = 0; k < 3; ++k) {
    frames.push_back({(k + 1) * kFrameNs, turned(k)});
    single.step(only, std::span(&frames.back(), 1));
    pictures.emplace_back(single.images().begin(), single.images().end());
  }
  EXPECT_NE(pictures[0], pictures[1]);
  EXPECT_NE(pictures[1], pictures[2]);
  for (const int drawn : {0, 1, 2, kLastFrame}) {
    AppBatch batch(oneDrum(1, 1.0));
    start(batch);
    batch.step(only, frames, drawn);
    const auto& expected = pictures[static_cast<std::size_t>(drawn == kLastFrame ? 2 : drawn)];
    EXPECT_TRUE(std::ranges::equal(batch.images(), expected)) << drawn;
    EXPECT_EQ(batch.rewards()[0], 1.0F);
    EXPECT_EQ(batch.hapticCounts()[0], 1);
    EXPECT_EQ(batch.app(0).stateHash(), single.app(0).stateHash());
  }
}

}  // namespace
}  // namespace sim2vr::runtime

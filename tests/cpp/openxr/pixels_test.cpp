// SPDX-License-Identifier: Apache-2.0
// Bytes derived by hand from the sRGB transfer function of IEC 61966-2-1:
// encoded = 12.92 l below 0.0031308, else 1.055 l^(1/2.4) - 0.055; the byte is encoded x 255,
// rounded.
#include "pixels.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <vector>

namespace sim2vr::openxr {
namespace {

template <class Number>
PixelView viewOf(PixelFormat format, const std::vector<Number>& numbers, std::uint32_t width,
                 std::uint32_t height, bool bottom_up = false) {
  return {format, reinterpret_cast<const std::byte*>(numbers.data()), width, height, bottom_up};
}

std::vector<int> shown(const PixelView& view, std::uint32_t width, std::uint32_t height) {
  std::vector<std::uint8_t> rgba(std::size_t{width} * height * 4);
  showColor(view, width, height, rgba);
  return {rgba.begin(), rgba.end()};
}

using Bytes = std::vector<std::uint8_t>;
using Halves = std::vector<std::uint16_t>;

TEST(Pixels, SrgbBytesAreShownAsTheyAre) {
  const Bytes pixels = {0, 1, 128, 7, 255, 64, 13, 200};
  EXPECT_EQ(shown(viewOf(PixelFormat::kRgba8Srgb, pixels, 2, 1), 2, 1),
            (std::vector<int>{0, 1, 128, 7, 255, 64, 13, 200}));
  EXPECT_EQ(shown(viewOf(PixelFormat::kBgra8Srgb, pixels, 2, 1), 2, 1),
            (std::vector<int>{128, 1, 0, 7, 13, 64, 255, 200}));
}

TEST(Pixels, LinearBytesAreEncoded) {
  // 51/255 = 0.2 -> 0.48453 -> 123.56; 128/255 -> 0.73654 -> 187.8; 1/255 = 0.0039216 -> 0.049833
  // -> 12.7
  const Bytes pixels = {51, 128, 1, 128, 0, 255, 51, 51};
  EXPECT_EQ(shown(viewOf(PixelFormat::kRgba8Linear, pixels, 2, 1), 2, 1),
            (std::vector<int>{124, 188, 13, 128, 0, 255, 124, 51}));
  EXPECT_EQ(shown(viewOf(PixelFormat::kBgra8Linear, pixels, 2, 1), 2, 1),
            (std::vector<int>{13, 188, 124, 128, 124, 255, 0, 51}));
}

TEST(Pixels, HalvesAreClampedAndEncoded) {
  // 0x3800 = 0.5 -> 188; 0x4000 = 2 -> 255; 0xBC00 = -1 -> 0; 0x7E00 = NaN -> 0; 0x7C00 = infinity;
  // 0x1000 = 2^-11 = 0.00048828 -> 12.92 x that x 255 = 1.609 -> 2; alpha 0x3400 = 0.25 -> 63.75.
  const Halves pixels = {0x3800, 0x4000, 0xBC00, 0x3400, 0x7E00, 0x7C00, 0x1000, 0x3C00};
  EXPECT_EQ(shown(viewOf(PixelFormat::kRgba16Float, pixels, 2, 1), 2, 1),
            (std::vector<int>{188, 255, 0, 64, 0, 255, 2, 255}));
}

TEST(Pixels, BottomUpRowsAreTurned) {
  const Bytes pixels = {1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};
  EXPECT_EQ(shown(viewOf(PixelFormat::kRgba8Srgb, pixels, 1, 3, true), 1, 3),
            (std::vector<int>{3, 3, 3, 3, 2, 2, 2, 2, 1, 1, 1, 1}));
}

TEST(Pixels, ReducingAveragesInLinearLight) {
  // Black and white average to linear 0.5: 188, not 128. Alpha is averaged as it is: 127.5.
  const Bytes pixels = {0, 0, 0, 0, 255, 255, 255, 255};
  EXPECT_EQ(shown(viewOf(PixelFormat::kRgba8Srgb, pixels, 2, 1), 1, 1),
            (std::vector<int>{188, 188, 188, 128}));
  // All pixels of a large image count: one white in 16 is linear 0.0625 -> 0.27771 -> 70.8.
  Bytes large(16 * 4, 0);
  std::fill_n(large.begin() + 5 * 4, 4, std::uint8_t{255});
  EXPECT_EQ(shown(viewOf(PixelFormat::kRgba8Linear, large, 4, 4), 1, 1),
            (std::vector<int>{71, 71, 71, 16}));
}

TEST(Pixels, EnlargingIsBilinear) {
  // Two pixels to four: 0, a quarter, three quarters, 1 in linear light.
  // 0.25 -> 0.53710 -> 137; 0.75 -> 0.88083 -> 224.6.
  const Bytes pixels = {0, 0, 0, 255, 255, 255, 255, 255};
  const std::vector<int> got = shown(viewOf(PixelFormat::kRgba8Linear, pixels, 2, 1), 4, 1);
  EXPECT_EQ((std::vector<int>{got[0], got[4], got[8], got[12]}),
            (std::vector<int>{0, 137, 225, 255}));
}

TEST(Pixels, EverySrgbByteSurvivesResampling) {
  Bytes pixels;
  for (int i = 0; i < 256; ++i) pixels.insert(pixels.end(), 8, static_cast<std::uint8_t>(i));
  const std::vector<int> got = shown(viewOf(PixelFormat::kRgba8Srgb, pixels, 2, 256), 1, 256);
  for (int i = 0; i < 256; ++i) {
    EXPECT_EQ(got[static_cast<std::size_t>(i) * 4], i);
    EXPECT_EQ(got[static_cast<std::size_t>(i) * 4 + 3], i);
  }
}

TEST(Pixels, DepthOfEveryFormat) {
  std::array<float, 2> depth{};
  const Halves d16 = {0, 16384};  // 16384/65535 = 0.2500038
  showDepth(viewOf(PixelFormat::kDepth16, d16, 2, 1), 2, 1, depth);
  EXPECT_FLOAT_EQ(depth[0], 0.0F);
  EXPECT_FLOAT_EQ(depth[1], 0.2500038F);
  // The upper 8 bits of 32 are undefined.
  const std::vector<std::uint32_t> d24 = {0xAB000000U, 0xCDFFFFFFU};
  showDepth(viewOf(PixelFormat::kDepth24, d24, 2, 1), 2, 1, depth);
  EXPECT_FLOAT_EQ(depth[0], 0.0F);
  EXPECT_FLOAT_EQ(depth[1], 1.0F);
  const std::vector<float> d32 = {0.125F, 0.75F};
  showDepth(viewOf(PixelFormat::kDepthFloat, d32, 1, 2, true), 1, 2, depth);
  EXPECT_FLOAT_EQ(depth[0], 0.75F);
  EXPECT_FLOAT_EQ(depth[1], 0.125F);
}

TEST(Pixels, DepthIsNeverMixed) {
  const std::vector<float> wide = {0.0F, 0.25F, 0.5F, 1.0F};
  std::array<float, 2> depth{};
  showDepth(viewOf(PixelFormat::kDepthFloat, wide, 4, 1), 2, 1, depth);
  EXPECT_FLOAT_EQ(depth[0], 0.25F);
  EXPECT_FLOAT_EQ(depth[1], 1.0F);
}

}  // namespace
}  // namespace sim2vr::openxr

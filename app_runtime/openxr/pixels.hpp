// SPDX-License-Identifier: Apache-2.0
// From a program's pixels to the picture of a screen: sRGB-encoded bytes, rows top-down, at the
// size that the simulated user sees. Done on the CPU, the same for OpenGL and Vulkan.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace sim2vr::openxr {

/// How one pixel lies in memory after a readback.
enum class PixelFormat {
  kRgba8Srgb,
  kBgra8Srgb,
  kRgba8Linear,
  kBgra8Linear,
  kRgba16Float,  // linear
  kDepth16,
  kDepth24,  // the low 24 bits of 32
  kDepthFloat,
};

/// The linear value of every byte, of an sRGB or of a linear format.
const std::array<float, 256>& linearValues(bool srgb);
/// The sRGB byte of a linear value, which is clamped to 0..1.
std::uint8_t linearToByte(float linear);

/// Return the bytes of one pixel.
std::size_t pixelBytes(PixelFormat format);

/// Pixels of one part of a swapchain's image, as read back, rows without padding.
struct PixelView {
  PixelFormat format;
  const std::byte* data;
  std::uint32_t width;
  std::uint32_t height;
  bool bottom_up;  // OpenGL: the first row is the lowest
};

/// Show `view` as `rgba` (width x height x 4 bytes, rows top-down, red, green and blue
/// sRGB-encoded, alpha as it is). Another size is resampled in linear light: bilinear when
/// enlarged, averaged over the covered area when reduced. Values outside 0..1 are clamped, NaN is
/// 0.
void showColor(const PixelView& view, std::uint32_t width, std::uint32_t height,
               std::span<std::uint8_t> rgba);

/// Show `view` as depth values (width x height, rows top-down); another size takes the nearest
/// pixel.
void showDepth(const PixelView& view, std::uint32_t width, std::uint32_t height,
               std::span<float> depth);

}  // namespace sim2vr::openxr

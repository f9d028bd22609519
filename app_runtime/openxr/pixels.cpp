// SPDX-License-Identifier: Apache-2.0
#include "pixels.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <vector>

namespace sim2vr::openxr {
namespace {

float srgbToLinear(float encoded) {
  return encoded <= 0.04045F ? encoded / 12.92F : std::pow((encoded + 0.055F) / 1.055F, 2.4F);
}

float clamped(float value) { return value > 0.0F ? std::min(value, 1.0F) : 0.0F; }

/// The linear values at which the rounded sRGB byte changes from i to i + 1.
std::array<float, 255> makeThresholds() {
  std::array<float, 255> thresholds{};
  for (std::size_t i = 0; i < thresholds.size(); ++i) {
    thresholds[i] = srgbToLinear((static_cast<float>(i) + 0.5F) / 255.0F);
  }
  return thresholds;
}

std::uint8_t alphaToByte(float alpha) {
  return static_cast<std::uint8_t>(std::lround(clamped(alpha) * 255.0F));
}

/// The sRGB byte of every linear byte.
const std::array<std::uint8_t, 256>& encodedBytes() {
  static const auto table = [] {
    std::array<std::uint8_t, 256> made{};
    for (std::size_t i = 0; i < made.size(); ++i) {
      made[i] = linearToByte(static_cast<float>(i) / 255.0F);
    }
    return made;
  }();
  return table;
}

/// What every half-precision number is shown as.
struct HalfTable {
  std::vector<float> linear = std::vector<float>(65536);  // clamped
  std::vector<std::uint8_t> encoded = std::vector<std::uint8_t>(65536);
  std::vector<std::uint8_t> alpha = std::vector<std::uint8_t>(65536);
};

const HalfTable& halfTable() {
  static const auto table = [] {
    HalfTable made;
    for (std::size_t i = 0; i < made.linear.size(); ++i) {
      made.linear[i] = clamped(std::bit_cast<Eigen::half>(static_cast<std::uint16_t>(i)));
      made.encoded[i] = linearToByte(made.linear[i]);
      made.alpha[i] = alphaToByte(made.linear[i]);
    }
    return made;
  }();
  return table;
}

bool isSrgb(PixelFormat format) {
  return format == PixelFormat::kRgba8Srgb || format == PixelFormat::kBgra8Srgb;
}

bool isBgra(PixelFormat format) {
  return format == PixelFormat::kBgra8Srgb || format == PixelFormat::kBgra8Linear;
}

const std::byte* rowOf(const PixelView& view, std::uint32_t y) {
  const std::uint32_t row = view.bottom_up ? view.height - 1 - y : y;
  return view.data + std::size_t{row} * view.width * pixelBytes(view.format);
}

std::uint16_t halfAt(const std::byte* row, std::size_t index) {
  std::uint16_t half = 0;
  std::memcpy(&half, row + 2 * index, sizeof(half));
  return half;
}

void showBytes(const PixelView& view, const std::byte* row, std::uint8_t* to) {
  const auto* from = reinterpret_cast<const std::uint8_t*>(row);
  const std::size_t red = isBgra(view.format) ? 2 : 0;
  const auto& table = encodedBytes();
  const bool encode = !isSrgb(view.format);
  for (std::size_t x = 0; x < view.width; ++x, from += 4, to += 4) {
    to[0] = encode ? table[from[red]] : from[red];
    to[1] = encode ? table[from[1]] : from[1];
    to[2] = encode ? table[from[2 - red]] : from[2 - red];
    to[3] = from[3];
  }
}

void showHalves(const PixelView& view, const std::byte* row, std::uint8_t* to) {
  const HalfTable& table = halfTable();
  for (std::size_t x = 0; x < view.width; ++x, to += 4) {
    for (std::size_t c = 0; c < 3; ++c) to[c] = table.encoded[halfAt(row, 4 * x + c)];
    to[3] = table.alpha[halfAt(row, 4 * x + 3)];
  }
}

void showSameSize(const PixelView& view, std::span<std::uint8_t> rgba) {
  const std::size_t row_bytes = std::size_t{view.width} * 4;
  for (std::uint32_t y = 0; y < view.height; ++y) {
    std::uint8_t* to = rgba.data() + y * row_bytes;
    const std::byte* row = rowOf(view, y);
    if (view.format == PixelFormat::kRgba8Srgb) {
      std::memcpy(to, row, row_bytes);
    } else if (view.format == PixelFormat::kRgba16Float) {
      showHalves(view, row, to);
    } else {
      showBytes(view, row, to);
    }
  }
}

struct Tap {
  std::uint32_t index;
  float weight;
};

/// For each of `to` output pixels the input pixels that it is made of, in order; weights add up
/// to 1.
std::vector<std::vector<Tap>> makeTaps(std::uint32_t from, std::uint32_t to) {
  const double scale = static_cast<double>(from) / to;
  const int samples = std::max(1, static_cast<int>(std::ceil(scale)));
  std::vector<std::vector<Tap>> taps(to);
  const auto add = [](std::vector<Tap>& list, std::uint32_t index, double weight) {
    if (weight <= 0.0) return;
    if (list.empty() || list.back().index != index) list.push_back({index, 0.0F});
    list.back().weight += static_cast<float>(weight);
  };
  for (std::uint32_t i = 0; i < to; ++i) {
    for (int k = 0; k < samples; ++k) {
      const double place = (i + (k + 0.5) / samples) * scale - 0.5;
      const double at = std::clamp(place, 0.0, static_cast<double>(from - 1));
      const auto low = static_cast<std::uint32_t>(at);
      const double fraction = at - low;
      add(taps[i], low, (1.0 - fraction) / samples);
      add(taps[i], std::min(low + 1, from - 1), fraction / samples);
    }
  }
  return taps;
}

std::array<float, 4> linearAt(const PixelView& view, const std::byte* row, std::uint32_t x) {
  std::array<float, 4> pixel{};
  if (view.format == PixelFormat::kRgba16Float) {
    const std::vector<float>& linear = halfTable().linear;
    for (std::size_t c = 0; c < 4; ++c) pixel[c] = linear[halfAt(row, std::size_t{x} * 4 + c)];
    return pixel;
  }
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(row) + std::size_t{x} * 4;
  const auto& table = linearValues(isSrgb(view.format));
  const std::size_t red = isBgra(view.format) ? 2 : 0;
  pixel[0] = table[bytes[red]];
  pixel[1] = table[bytes[1]];
  pixel[2] = table[bytes[2 - red]];
  pixel[3] = static_cast<float>(bytes[3]) / 255.0F;
  return pixel;
}

void resample(const PixelView& view, std::uint32_t width, std::uint32_t height,
              std::span<std::uint8_t> rgba) {
  const auto columns = makeTaps(view.width, width);
  const auto rows = makeTaps(view.height, height);
  std::uint8_t* to = rgba.data();
  for (std::uint32_t y = 0; y < height; ++y) {
    for (std::uint32_t x = 0; x < width; ++x, to += 4) {
      std::array<float, 4> sum{};
      for (const Tap& v : rows[y]) {
        const std::byte* row = rowOf(view, v.index);
        for (const Tap& h : columns[x]) {
          const std::array<float, 4> pixel = linearAt(view, row, h.index);
          for (std::size_t c = 0; c < 4; ++c) sum[c] += pixel[c] * v.weight * h.weight;
        }
      }
      for (std::size_t c = 0; c < 3; ++c) to[c] = linearToByte(sum[c]);
      to[3] = alphaToByte(sum[3]);
    }
  }
}

float depthAt(const PixelView& view, const std::byte* row, std::size_t x) {
  if (view.format == PixelFormat::kDepth16) {
    return static_cast<float>(halfAt(row, x)) / 65535.0F;  // two bytes, unsigned
  }
  std::uint32_t bits = 0;
  std::memcpy(&bits, row + 4 * x, sizeof(bits));
  if (view.format == PixelFormat::kDepthFloat) return std::bit_cast<float>(bits);
  return static_cast<float>(static_cast<double>(bits & 0xFFFFFFU) / 16777215.0);
}

}  // namespace

const std::array<float, 256>& linearValues(bool srgb) {
  static const auto tables = [] {
    std::array<std::array<float, 256>, 2> made{};
    for (std::size_t i = 0; i < 256; ++i) {
      const float value = static_cast<float>(i) / 255.0F;
      made[0][i] = value;
      made[1][i] = srgbToLinear(value);
    }
    return made;
  }();
  return tables[srgb ? 1 : 0];
}

std::uint8_t linearToByte(float linear) {
  static const std::array<float, 255> thresholds = makeThresholds();
  return static_cast<std::uint8_t>(
      std::upper_bound(thresholds.begin(), thresholds.end(), clamped(linear)) - thresholds.begin());
}

std::size_t pixelBytes(PixelFormat format) {
  switch (format) {
    case PixelFormat::kRgba16Float:
      return 8;
    case PixelFormat::kDepth16:
      return 2;
    default:
      return 4;
  }
}

void showColor(const PixelView& view, std::uint32_t width, std::uint32_t height,
               std::span<std::uint8_t> rgba) {
  if (view.width == width && view.height == height) {
    showSameSize(view, rgba);
  } else {
    resample(view, width, height, rgba);
  }
}

void showDepth(const PixelView& view, std::uint32_t width, std::uint32_t height,
               std::span<float> depth) {
  float* to = depth.data();
  for (std::uint32_t y = 0; y < height; ++y) {
    const auto from_y = static_cast<std::uint32_t>((y + 0.5) * view.height / height);
    const std::byte* row = rowOf(view, std::min(from_y, view.height - 1));
    for (std::uint32_t x = 0; x < width; ++x) {
      const auto from_x = static_cast<std::uint32_t>((x + 0.5) * view.width / width);
      *to++ = depthAt(view, row, std::min(from_x, view.width - 1));
    }
  }
}

}  // namespace sim2vr::openxr

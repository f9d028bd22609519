// SPDX-License-Identifier: Apache-2.0
// Reads the PNGs of protocol 1.
#pragma once

#include <png.h>

#include <nlohmann/json.hpp>
#include <stdexcept>
#include <vector>

#include "sim2vr/render/image_size.hpp"

namespace sim2vr::server::testing {

struct Image {
  render::ImageSize size;
  std::vector<std::uint8_t> rgba;
};

/// From the JSON array of a file's bytes.
inline Image decodePng(const nlohmann::json& numbers) {
  const auto bytes = numbers.get<std::vector<std::uint8_t>>();
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  if (png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()) == 0) {
    throw std::runtime_error(png.message);
  }
  png.format = PNG_FORMAT_RGBA;
  Image image{{static_cast<int>(png.width), static_cast<int>(png.height)},
              std::vector<std::uint8_t>(PNG_IMAGE_SIZE(png))};
  if (png_image_finish_read(&png, nullptr, image.rgba.data(), 0, nullptr) == 0) {
    throw std::runtime_error(png.message);
  }
  return image;
}

}  // namespace sim2vr::server::testing

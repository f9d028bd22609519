// SPDX-License-Identifier: Apache-2.0
// Images to files and to the bytes of files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "sim2vr/render/image_size.hpp"

namespace sim2vr::render {

/// Writes an 8-bit PNG. `pixels`: height x width x channels, row 0 = top, no padding; channels 1
/// (grey), 3 (RGB) or 4 (RGBA; not premultiplied). Throws InvalidArgument for a size or channel
/// count that does not fit the data, EngineError when the file cannot be written.
void writePng(const std::filesystem::path& path, ImageSize size,
              std::span<const std::uint8_t> pixels, int channels = 4);

/// The bytes of such a PNG, compressed little for speed. Throws as writePng does.
std::string encodePng(ImageSize size, std::span<const std::uint8_t> pixels, int channels = 4);

}  // namespace sim2vr::render

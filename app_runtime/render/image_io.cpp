// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/render/image_io.hpp"

#include <png.h>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::render {
namespace {

png_uint_32 pngFormat(int channels) {
  switch (channels) {
    case 1:
      return PNG_FORMAT_GRAY;
    case 3:
      return PNG_FORMAT_RGB;
    case 4:
      return PNG_FORMAT_RGBA;
    default:
      throw InvalidArgument("channels", std::to_string(channels), "1, 3 or 4");
  }
}

png_image describe(ImageSize size, std::span<const std::uint8_t> pixels, int channels) {
  checkImageSize(size);
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(size.width);
  image.height = static_cast<png_uint_32>(size.height);
  image.format = pngFormat(channels);
  const std::size_t expected = size.pixels() * static_cast<std::size_t>(channels);
  if (pixels.size() != expected) {
    throw InvalidArgument("pixels", std::to_string(pixels.size()) + " bytes",
                          std::to_string(expected) + " bytes (height x width x channels)");
  }
  return image;
}

}  // namespace

void checkImageSize(ImageSize size) {
  const auto usable = [](int edge) { return edge >= 1 && edge <= kMaxImageEdge; };
  if (usable(size.width) && usable(size.height)) return;
  throw InvalidArgument("image size",
                        std::to_string(size.width) + " x " + std::to_string(size.height),
                        "width and height from 1 to " + std::to_string(kMaxImageEdge) + " pixels");
}

void writePng(const std::filesystem::path& path, ImageSize size,
              std::span<const std::uint8_t> pixels, int channels) {
  png_image image = describe(size, pixels, channels);
  if (png_image_write_to_file(&image, path.c_str(), 0, pixels.data(), 0, nullptr) == 0) {
    throw EngineError("cannot write the image " + path.string() + ": " + image.message);
  }
}

std::string encodePng(ImageSize size, std::span<const std::uint8_t> pixels, int channels) {
  png_image image = describe(size, pixels, channels);
  image.flags = PNG_IMAGE_FLAG_FAST;
  png_alloc_size_t bytes = PNG_IMAGE_PNG_SIZE_MAX(image);
  std::string png(bytes, '\0');
  if (png_image_write_to_memory(&image, png.data(), &bytes, 0, pixels.data(), 0, nullptr) == 0) {
    throw EngineError(std::string("cannot encode an image as PNG: ") + image.message);
  }
  png.resize(bytes);
  return png;
}

}  // namespace sim2vr::render

// SPDX-License-Identifier: Apache-2.0
// Width and height of an image.
#pragma once

#include <cstddef>

namespace sim2vr::render {

/// In pixels.
struct ImageSize {
  int width = 0;
  int height = 0;

  std::size_t pixels() const {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  }
  bool operator==(const ImageSize&) const = default;
};

/// Largest width or height that can be rendered or written.
inline constexpr int kMaxImageEdge = 8192;

/// Throws InvalidArgument("image size", ...) unless both edges lie in [1, kMaxImageEdge].
void checkImageSize(ImageSize size);

}  // namespace sim2vr::render

// SPDX-License-Identifier: Apache-2.0
// Graphics of the tests: an image is one colour and one depth.
#include <cstring>
#include <vector>

#include "graphics.hpp"
#include "program.hpp"

namespace sim2vr::openxr {
namespace {

class Images final : public SwapchainImages {
 public:
  explicit Images(bool of_depth) : depth(of_depth) {}
  std::uint32_t count() const override { return 3; }
  void describe(XrSwapchainImageBaseHeader* images) const override {
    auto* to = reinterpret_cast<test::PixelsImage*>(images);
    for (std::uint32_t i = 0; i < 3; ++i) to[i].rgba = pixels_[i];
  }
  const std::uint8_t* pixels(std::uint32_t index) const { return pixels_[index]; }

  const bool depth;

 private:
  mutable std::uint8_t pixels_[3][8]{};
};

class Pixels final : public Graphics {
 public:
  std::string_view name() const override { return "pixels"; }
  XrStructureType imageType() const override { return test::kPixelsImage; }
  std::span<const std::int64_t> formats() const override {
    static constexpr std::int64_t kFormats[]{test::kColorFormat, test::kDepthFormat};
    return kFormats;
  }
  bool isDepth(std::int64_t format) const override { return format == test::kDepthFormat; }
  std::unique_ptr<SwapchainImages> createImages(const XrSwapchainCreateInfo& info) override {
    return std::make_unique<Images>(isDepth(info.format));
  }
  PixelView read(const ImagePart& part) override {
    const auto& images = *static_cast<const Images*>(part.images);
    const std::uint8_t* pixel = images.pixels(part.index) + (images.depth ? 4 : 0);
    const auto width = static_cast<std::uint32_t>(part.rect.extent.width);
    const auto height = static_cast<std::uint32_t>(part.rect.extent.height);
    pixels_.resize(std::size_t{4} * width * height);
    for (std::size_t i = 0; i < pixels_.size(); i += 4) std::memcpy(&pixels_[i], pixel, 4);
    return {images.depth ? PixelFormat::kDepthFloat : PixelFormat::kRgba8Srgb, pixels_.data(),
            width, height, false};
  }

 private:
  std::vector<std::byte> pixels_;
};

}  // namespace

std::span<const GraphicsMaker> graphicsMakers() {
  static const GraphicsMaker maker{test::kPixels,
                                   1,
                                   test::kPixelsBinding,
                                   "",
                                   [](const XrBaseInStructure&) -> std::unique_ptr<Graphics> {
                                     return std::make_unique<Pixels>();
                                   },
                                   nullptr};
  return {&maker, 1};
}

}  // namespace sim2vr::openxr

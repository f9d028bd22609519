// Graphics of the tests: an image is one colour and one depth.
#include <cstring>

#include "graphics.hpp"
#include "program.hpp"

namespace sim2vr::openxr {
namespace {

class Images final : public SwapchainImages {
 public:
  std::uint32_t count() const override { return 3; }
  void describe(XrSwapchainImageBaseHeader* images) const override {
    auto* to = reinterpret_cast<test::PixelsImage*>(images);
    for (std::uint32_t i = 0; i < 3; ++i) to[i].rgba = pixels_[i];
  }
  const std::uint8_t* pixels(std::uint32_t index) const { return pixels_[index]; }

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
  std::unique_ptr<SwapchainImages> createImages(const XrSwapchainCreateInfo&) override {
    return std::make_unique<Images>();
  }
  void readColor(const ImagePart& part, std::uint32_t width, std::uint32_t height,
                 std::span<std::uint8_t> rgba) override {
    for (std::uint32_t i = 0; i < width * height; ++i) {
      std::memcpy(&rgba[i * 4], static_cast<const Images*>(part.images)->pixels(part.index), 4);
    }
  }
  void readDepth(const ImagePart& part, std::uint32_t width, std::uint32_t height,
                 std::span<float> depth) override {
    float value = 0.0F;
    std::memcpy(&value, static_cast<const Images*>(part.images)->pixels(part.index) + 4, 4);
    std::fill_n(depth.begin(), width * height, value);
  }
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

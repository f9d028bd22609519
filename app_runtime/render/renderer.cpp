// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/render/renderer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdlib>

#include "gl_renderer.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"

namespace sim2vr::render {
namespace {

const std::array<std::string, 4> kKindNames = {"automatic", "egl", "osmesa", "null"};

class NullRenderer final : public Renderer {
 public:
  RendererKind kind() const override { return RendererKind::null; }
  const std::string& description() const override { return description_; }
  bool drawsOnCpu() const override { return true; }
  void renderBatch(std::span<const ViewRequest> requests) override {
    for (const ViewRequest& each : requests) {
      checkRenderArguments(each);
      std::fill(each.rgba.begin(), each.rgba.end(), std::uint8_t{0});
      for (std::size_t i = 3; i < each.rgba.size(); i += 4) each.rgba[i] = 255;
      std::fill(each.depth_m.begin(), each.depth_m.end(), static_cast<float>(each.camera.far_m));
    }
  }

 private:
  std::string description_ = "null renderer: no pictures";
};

std::shared_ptr<Renderer> createGl(RendererKind kind) {
  // Read when Mesa's CPU driver starts; see Renderer::create.
  setenv("LP_NUM_THREADS", "0", /*overwrite=*/0);
  return std::make_shared<GlRenderer>(
      kind, kind == RendererKind::egl ? createEglContext() : createOsMesaContext());
}

std::shared_ptr<Renderer> createAutomatic() {
  std::string problems;
  for (const RendererKind kind : {RendererKind::egl, RendererKind::osmesa}) {
    try {
      return createGl(kind);
    } catch (const RenderError& error) {
      logger().info("renderer: {} does not start: {}", rendererKindName(kind), error.what());
      problems += fmt::format("\n  {}: {}", rendererKindName(kind), error.what());
    }
  }
  throw RenderError("no renderer starts on this machine:" + problems +
                    "\n  or choose the renderer 'null' for policies that do not look");
}

}  // namespace

std::string_view rendererKindName(RendererKind kind) {
  return kKindNames.at(static_cast<std::size_t>(kind));
}

RendererKind rendererKindFromName(std::string_view name) {
  for (std::size_t i = 0; i < kKindNames.size(); ++i) {
    if (kKindNames[i] == name) return static_cast<RendererKind>(i);
  }
  throw InvalidArgument("renderer", "'" + std::string(name) + "'",
                        listChoices(kKindNames) + didYouMean(name, kKindNames));
}

void Renderer::checkRenderArguments(const ViewRequest& request) {
  const ImageSize size = request.size;
  checkImageSize(size);
  if (!request.depth_m.empty() && request.depth_m.size() != size.pixels()) {
    throw InvalidArgument("depth buffer", fmt::format("{} numbers", request.depth_m.size()),
                          fmt::format("{} (height x width)", size.pixels()));
  }
  if (request.rgba.size() != 4 * size.pixels()) {
    throw InvalidArgument("rgba buffer", fmt::format("{} bytes", request.rgba.size()),
                          fmt::format("{} bytes (height {} x width {} x 4)", 4 * size.pixels(),
                                      size.height, size.width));
  }
}

std::shared_ptr<Renderer> Renderer::create(RendererKind kind) {
  switch (kind) {
    case RendererKind::automatic:
      return createAutomatic();
    case RendererKind::null:
      return std::make_shared<NullRenderer>();
    default:
      return createGl(kind);
  }
}

}  // namespace sim2vr::render

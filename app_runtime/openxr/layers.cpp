// SPDX-License-Identifier: Apache-2.0
// Checks of layers.
#include "layers.hpp"

#include <cmath>

#include "check.hpp"
#include "session_state.hpp"
#include "system.hpp"

namespace sim2vr::openxr {
namespace {

constexpr XrCompositionLayerFlags kLayerFlags =
    XR_COMPOSITION_LAYER_CORRECT_CHROMATIC_ABERRATION_BIT |
    XR_COMPOSITION_LAYER_BLEND_TEXTURE_SOURCE_ALPHA_BIT |
    XR_COMPOSITION_LAYER_UNPREMULTIPLIED_ALPHA_BIT;

/// The session's swapchain of a sub-image; its rectangle lies inside.
void checkSubImage(const Session& session, const XrSwapchainSubImage& image,
                   const std::string& name) {
  const auto swapchain = get<Swapchain>(image.swapchain, "swapchain of a layer");
  requireOwn(session, swapchain->session.get(), name + ".swapchain");
  if (!swapchain->released) {
    throw Failure(XR_ERROR_LAYER_INVALID, name + ".swapchain has no image that was released");
  }
  if (image.imageArrayIndex >= swapchain->info.arraySize) {
    invalid(fmt::format("{}.imageArrayIndex is {}, expected below {}", name, image.imageArrayIndex,
                        swapchain->info.arraySize));
  }
  const XrOffset2Di& offset = image.imageRect.offset;
  const XrExtent2Di& extent = image.imageRect.extent;
  const bool inside = offset.x >= 0 && offset.y >= 0 && extent.width > 0 && extent.height > 0 &&
                      static_cast<std::int64_t>(offset.x) + extent.width <= swapchain->info.width &&
                      static_cast<std::int64_t>(offset.y) + extent.height <= swapchain->info.height;
  if (!inside) {
    throw Failure(XR_ERROR_SWAPCHAIN_RECT_INVALID,
                  fmt::format("{}.imageRect is {} {} {} {}, expected inside {} x {}", name,
                              offset.x, offset.y, extent.width, extent.height,
                              swapchain->info.width, swapchain->info.height));
  }
}

void checkDepth(const Session& session, const XrCompositionLayerProjectionView& view,
                const std::string& name) {
  if (!session.instance->enabled("XR_KHR_composition_layer_depth")) return;
  const auto* depth =
      chained<XrCompositionLayerDepthInfoKHR>(view.next, XR_TYPE_COMPOSITION_LAYER_DEPTH_INFO_KHR);
  if (depth == nullptr) return;
  checkSubImage(session, depth->subImage, name + " depth");
  const auto swapchain = get<Swapchain>(depth->subImage.swapchain, "swapchain of a layer");
  if (!session.graphics->isDepth(swapchain->info.format)) {
    invalid(name + " depth: the swapchain's format holds no depth");
  }
  const bool fits = depth->minDepth >= 0.0F && depth->maxDepth <= 1.0F &&
                    depth->minDepth < depth->maxDepth && depth->nearZ != depth->farZ &&
                    depth->nearZ >= 0.0F && depth->farZ >= 0.0F;
  if (!fits) {
    invalid(fmt::format("{} depth: minDepth {}, maxDepth {}, nearZ {}, farZ {}", name,
                        depth->minDepth, depth->maxDepth, depth->nearZ, depth->farZ));
  }
}

void checkProjection(const Session& session, const XrCompositionLayerProjection& layer,
                     const std::string& name) {
  if (layer.viewCount != kEyes) {
    invalid(fmt::format("{}.viewCount is {}, expected 2", name, layer.viewCount));
  }
  requirePointer(layer.views, "layer->views");
  requireTypes(layer.views, layer.viewCount, XR_TYPE_COMPOSITION_LAYER_PROJECTION_VIEW, "views");
  for (std::uint32_t i = 0; i < layer.viewCount; ++i) {
    const XrCompositionLayerProjectionView& view = layer.views[i];
    const std::string view_name = fmt::format("{}.views[{}]", name, i);
    requirePose(view.pose, view_name + ".pose");
    const XrFovf& fov = view.fov;
    if (!std::isfinite(fov.angleLeft + fov.angleRight + fov.angleUp + fov.angleDown)) {
      invalid(view_name + ".fov is not finite");
    }
    checkSubImage(session, view.subImage, view_name + ".subImage");
    checkDepth(session, view, view_name);
  }
}

void checkQuad(const Session& session, const XrCompositionLayerQuad& layer,
               const std::string& name) {
  requirePose(layer.pose, name + ".pose");
  if (!std::isfinite(layer.size.width + layer.size.height)) invalid(name + ".size is not finite");
  if (layer.eyeVisibility < XR_EYE_VISIBILITY_BOTH ||
      layer.eyeVisibility > XR_EYE_VISIBILITY_RIGHT) {
    invalid(fmt::format("{}.eyeVisibility is {}", name, static_cast<int>(layer.eyeVisibility)));
  }
  checkSubImage(session, layer.subImage, name + ".subImage");
}

}  // namespace

void checkLayers(const Session& session, const XrFrameEndInfo& info) {
  if (info.layerCount > kMaximumLayers) {
    throw Failure(XR_ERROR_LAYER_LIMIT_EXCEEDED,
                  fmt::format("{} layers, expected up to {}", info.layerCount, kMaximumLayers));
  }
  for (std::uint32_t i = 0; i < info.layerCount; ++i) {
    const std::string name = fmt::format("layers[{}]", i);
    if (info.layers == nullptr || info.layers[i] == nullptr) {
      throw Failure(XR_ERROR_LAYER_INVALID, name + " is null");
    }
    const XrCompositionLayerBaseHeader& layer = *info.layers[i];
    if (layer.type != XR_TYPE_COMPOSITION_LAYER_PROJECTION &&
        layer.type != XR_TYPE_COMPOSITION_LAYER_QUAD) {
      throw Failure(XR_ERROR_LAYER_INVALID,
                    fmt::format("{}.type is {}, expected a projection or a quad layer", name,
                                static_cast<int>(layer.type)));
    }
    if ((layer.layerFlags & ~kLayerFlags) != 0) {
      invalid(fmt::format("{}.layerFlags is {:#x}, expected bits of {:#x}", name, layer.layerFlags,
                          kLayerFlags));
    }
    const auto space = get<Space>(layer.space, "space of a layer");
    requireOwn(session, space->session.get(), name + ".space");
    if (layer.type == XR_TYPE_COMPOSITION_LAYER_PROJECTION) {
      checkProjection(session, reinterpret_cast<const XrCompositionLayerProjection&>(layer), name);
    } else {
      checkQuad(session, reinterpret_cast<const XrCompositionLayerQuad&>(layer), name);
    }
  }
}

}  // namespace sim2vr::openxr

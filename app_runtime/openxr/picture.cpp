// SPDX-License-Identifier: Apache-2.0
// Layers composed into the picture that the harness gets.
#include <algorithm>
#include <cmath>
#include <limits>

#include "check.hpp"
#include "layers.hpp"
#include "pixels.hpp"
#include "system.hpp"

namespace sim2vr::openxr {
namespace {

constexpr std::uint8_t kFarthest = 255;

ImagePart partOf(const XrSwapchainSubImage& image) {
  const auto swapchain = get<Swapchain>(image.swapchain, "swapchain of a layer");
  return {swapchain->images.get(), *swapchain->released, image.imageArrayIndex, image.imageRect};
}

/// Some programs turn the picture over by a field of view whose upper angle is the smaller one.
void flipRows(std::span<std::uint8_t> rows, std::size_t row_bytes) {
  const std::size_t count = rows.size() / row_bytes;
  for (std::size_t i = 0; i < count / 2; ++i) {
    const auto upper = rows.subspan(i * row_bytes, row_bytes);
    const auto lower = rows.subspan((count - 1 - i) * row_bytes, row_bytes);
    std::swap_ranges(upper.begin(), upper.end(), lower.begin());
  }
}

/// One pixel over another, in linear light as OpenXR says. The alpha of `under` is its depth.
void blend(std::uint8_t* under, const std::uint8_t* over, XrCompositionLayerFlags flags) {
  if ((flags & XR_COMPOSITION_LAYER_BLEND_TEXTURE_SOURCE_ALPHA_BIT) == 0 || over[3] == 255) {
    std::copy_n(over, 3, under);
    return;
  }
  const bool straight = (flags & XR_COMPOSITION_LAYER_UNPREMULTIPLIED_ALPHA_BIT) != 0;
  const float alpha = static_cast<float>(over[3]) / 255.0F;
  const auto& linear = linearValues(true);
  for (int c = 0; c < 3; ++c) {
    const float source = straight ? linear[over[c]] * alpha : linear[over[c]];
    under[c] = linearToByte(source + linear[under[c]] * (1.0F - alpha));
  }
}

/// Distance along the view axis of a depth value, as XR_KHR_composition_layer_depth defines it.
double metres(const XrCompositionLayerDepthInfoKHR& info, float value) {
  const double unit =
      (value - info.minDepth) / (static_cast<double>(info.maxDepth) - info.minDepth);
  const double inverse = (1.0 - unit) / info.nearZ + unit / info.farZ;
  return inverse > 0.0 ? 1.0 / inverse : std::numeric_limits<double>::infinity();
}

/// The renderer's depth channel: of 255 steps, 255 = farthest_m and beyond.
std::uint8_t depthByte(double depth_m, double farthest_m) {
  const double share = depth_m / farthest_m;
  if (!(share < 1.0)) return kFarthest;
  return static_cast<std::uint8_t>(std::floor(std::max(0.0, share) * 255.0 + 0.5));
}

const XrCompositionLayerDepthInfoKHR* depthOf(const Instance& instance,
                                              const XrCompositionLayerProjectionView& view) {
  if (!instance.config.depth || !instance.enabled("XR_KHR_composition_layer_depth")) {
    return nullptr;
  }
  return chained<XrCompositionLayerDepthInfoKHR>(view.next,
                                                 XR_TYPE_COMPOSITION_LAYER_DEPTH_INFO_KHR);
}

/// Everything that will be read, so that it is fetched together.
std::vector<ImagePart> partsOf(const Instance& instance, const XrFrameEndInfo& info) {
  std::vector<ImagePart> parts;
  for (std::uint32_t i = 0; i < info.layerCount; ++i) {
    const XrCompositionLayerBaseHeader& layer = *info.layers[i];
    if (layer.type == XR_TYPE_COMPOSITION_LAYER_QUAD) {
      parts.push_back(partOf(reinterpret_cast<const XrCompositionLayerQuad&>(layer).subImage));
      continue;
    }
    const auto& projection = reinterpret_cast<const XrCompositionLayerProjection&>(layer);
    for (std::uint32_t eye = 0; eye < instance.config.eyes; ++eye) {
      const XrCompositionLayerProjectionView& view = projection.views[eye];
      parts.push_back(partOf(view.subImage));
      if (const auto* depth = depthOf(instance, view)) parts.push_back(partOf(depth->subImage));
    }
  }
  return parts;
}

struct Eye {
  std::uint32_t index;
  std::uint32_t width;
  std::uint32_t height;
  std::span<std::uint8_t> rgba;
};

bool drawDepth(Session& session, const XrCompositionLayerProjectionView& view, const Eye& eye) {
  const auto* info = depthOf(*session.instance, view);
  if (info == nullptr) return false;
  std::vector<float> depth(static_cast<std::size_t>(eye.width) * eye.height);
  session.graphics->readDepth(partOf(info->subImage), eye.width, eye.height, depth);
  const double farthest_m = session.instance->config.farthest_m;
  const bool flipped = view.fov.angleUp < view.fov.angleDown;
  for (std::uint32_t row = 0; row < eye.height; ++row) {
    const std::uint32_t from = flipped ? eye.height - 1 - row : row;
    for (std::uint32_t column = 0; column < eye.width; ++column) {
      const float value = depth[static_cast<std::size_t>(from) * eye.width + column];
      eye.rgba[(static_cast<std::size_t>(row) * eye.width + column) * 4 + 3] =
          depthByte(metres(*info, value), farthest_m);
    }
  }
  return true;
}

void drawProjection(Session& session, const XrCompositionLayerProjection& layer, const Eye& eye,
                    bool first) {
  const XrCompositionLayerProjectionView& view = layer.views[eye.index];
  std::vector<std::uint8_t> pixels(eye.rgba.size());
  session.graphics->readColor(partOf(view.subImage), eye.width, eye.height, pixels);
  if (view.fov.angleUp < view.fov.angleDown) {
    flipRows(pixels, static_cast<std::size_t>(eye.width) * 4);
  }
  // Nothing lies under the first layer.
  const XrCompositionLayerFlags flags = first ? 0 : layer.layerFlags;
  for (std::size_t i = 0; i < pixels.size(); i += 4) blend(&eye.rgba[i], &pixels[i], flags);
}

using Vector = Eigen::Vector3d;

/// A point given in the frame of `pose`.
Vector moved(const XrPosef& pose, const Vector& point) {
  const Eigen::Quaterniond q(pose.orientation.w, pose.orientation.x, pose.orientation.y,
                             pose.orientation.z);
  return q * point + Vector(pose.position.x, pose.position.y, pose.position.z);
}

/// A quad is seen from its front only.
void drawQuad(Session& session, const XrCompositionLayerQuad& layer, const Eye& eye, XrTime time) {
  const auto hidden = eye.index == 0 ? XR_EYE_VISIBILITY_RIGHT : XR_EYE_VISIBILITY_LEFT;
  const auto space = get<Space>(layer.space, "space of a layer");
  const auto stage_T_space = session.tracking.locate(*space, time);
  const double width_m = layer.size.width;
  const double height_m = layer.size.height;
  if (layer.eyeVisibility == hidden || !stage_T_space || !(width_m > 0.0) || !(height_m > 0.0)) {
    return;
  }
  const auto columns = static_cast<std::uint32_t>(layer.subImage.imageRect.extent.width);
  const auto rows = static_cast<std::uint32_t>(layer.subImage.imageRect.extent.height);
  std::vector<std::uint8_t> texture(static_cast<std::size_t>(columns) * rows * 4);
  session.graphics->readColor(partOf(layer.subImage), columns, rows, texture);
  const XrPosef stage_T_quad = xr::compose(stage_T_space->pose, layer.pose);
  const xr::Space view = xr::eyeSpace(eye.index, session.instance->config.ipd_m);
  const XrPosef quad_T_eye =
      xr::compose(xr::inverse(stage_T_quad), session.tracking.locate(view, time)->pose);
  const Vector origin = moved(quad_T_eye, Vector::Zero());
  if (!(origin.z() > 0.0)) return;
  const XrFovf fov = session.instance->config.fov();
  const double half_x = std::tan(static_cast<double>(fov.angleRight));
  const double half_y = std::tan(static_cast<double>(fov.angleUp));
  for (std::uint32_t row = 0; row < eye.height; ++row) {
    for (std::uint32_t column = 0; column < eye.width; ++column) {
      const Vector ray((2.0 * (column + 0.5) / eye.width - 1.0) * half_x,
                       (1.0 - 2.0 * (row + 0.5) / eye.height) * half_y, -1.0);
      const Vector direction = moved(quad_T_eye, ray) - origin;
      if (!(direction.z() < 0.0)) continue;
      const Vector hit = origin - direction * (origin.z() / direction.z());
      const double u = hit.x() / width_m + 0.5;
      const double v = 0.5 - hit.y() / height_m;
      if (!(u >= 0.0 && u < 1.0 && v >= 0.0 && v < 1.0)) continue;
      const std::size_t texel =
          (static_cast<std::size_t>(v * rows) * columns + static_cast<std::size_t>(u * columns)) *
          4;
      blend(&eye.rgba[(static_cast<std::size_t>(row) * eye.width + column) * 4], &texture[texel],
            layer.layerFlags);
    }
  }
}

}  // namespace

Picture composePicture(Session& session, const XrFrameEndInfo& info) {
  const Config& config = session.instance->config;
  Picture picture;
  picture.rgba.assign(config.eyes * config.eyeBytes(), 0);
  picture.has_image = true;
  session.graphics->prefetch(partsOf(*session.instance, info));
  const std::span<std::uint8_t> all(picture.rgba);
  for (std::uint32_t index = 0; index < config.eyes; ++index) {
    const Eye eye{index, config.width, config.height,
                  all.subspan(index * config.eyeBytes(), config.eyeBytes())};
    for (std::size_t i = 3; i < eye.rgba.size(); i += 4) eye.rgba[i] = kFarthest;
    bool has_depth = false;
    for (std::uint32_t i = 0; i < info.layerCount; ++i) {
      const XrCompositionLayerBaseHeader& layer = *info.layers[i];
      if (layer.type == XR_TYPE_COMPOSITION_LAYER_QUAD) {
        drawQuad(session, reinterpret_cast<const XrCompositionLayerQuad&>(layer), eye,
                 info.displayTime);
        continue;
      }
      const auto& projection = reinterpret_cast<const XrCompositionLayerProjection&>(layer);
      drawProjection(session, projection, eye, i == 0);
      has_depth = has_depth || drawDepth(session, projection.views[index], eye);
    }
    picture.has_depth = has_depth;
  }
  return picture;
}

}  // namespace sim2vr::openxr

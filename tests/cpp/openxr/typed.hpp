// SPDX-License-Identifier: Apache-2.0
// OpenXR structures with their type and zeros.
#pragma once

#include <openxr/openxr.h>

#include <cstdint>

namespace sim2vr::openxr {

template <class Structure>
Structure typed(XrStructureType type) {
  Structure made{};
  made.type = type;
  return made;
}

/// A swapchain of images that are sampled, and used as `usage` says.
inline XrSwapchainCreateInfo swapchainInfo(XrSwapchainUsageFlags usage, std::int64_t format,
                                           std::uint32_t width, std::uint32_t height,
                                           std::uint32_t layers, std::uint32_t samples) {
  auto info = typed<XrSwapchainCreateInfo>(XR_TYPE_SWAPCHAIN_CREATE_INFO);
  info.usageFlags = usage | XR_SWAPCHAIN_USAGE_SAMPLED_BIT;
  info.format = format;
  info.sampleCount = samples;
  info.width = width;
  info.height = height;
  info.faceCount = 1;
  info.arraySize = layers;
  info.mipCount = 1;
  return info;
}

}  // namespace sim2vr::openxr

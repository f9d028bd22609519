// SPDX-License-Identifier: Apache-2.0
// What the simulated headset can do.
#pragma once

#include <cstdint>

#include "api.hpp"

namespace sim2vr::openxr {

inline constexpr std::uint32_t kEyes = 2;
inline constexpr std::uint32_t kMaximumLayers = XR_MIN_COMPOSITION_LAYERS_SUPPORTED;
/// Of a swapchain's image, along each side.
inline constexpr std::uint32_t kMaximumImageSize = 8192;
/// Of a colour image; every device of Vulkan and the OpenGL drivers tried have as many.
inline constexpr std::uint32_t kMaximumSamples = 4;

/// Throws Failure (XR_ERROR_VIEW_CONFIGURATION_TYPE_UNSUPPORTED).
void requireStereo(XrViewConfigurationType type);

}  // namespace sim2vr::openxr

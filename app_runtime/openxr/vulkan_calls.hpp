// SPDX-License-Identifier: Apache-2.0
// What the runtime learns of the program's Vulkan instances before there is a session, and the
// functions of XR_KHR_vulkan_enable and XR_KHR_vulkan_enable2 by which it does.
#pragma once

#include <vulkan/vulkan_core.h>

#include <string_view>

#include "graphics.hpp"

namespace sim2vr::openxr {

struct VulkanInstance {
  PFN_vkGetInstanceProcAddr lookup = nullptr;
  /// What xrGetVulkanGraphicsDevice(2)KHR returned last; null: not called.
  VkPhysicalDevice physical_device = VK_NULL_HANDLE;
};

/// How to reach `instance`: through the program's own function where xrCreateVulkanInstanceKHR
/// received one, else through libvulkan. Throws GraphicsError where there is neither.
VulkanInstance findVulkanInstance(VkInstance instance);

/// Functions of XR_KHR_vulkan_enable by name; null for another name.
PFN_xrVoidFunction vulkanFunction(std::string_view name);
/// Functions of XR_KHR_vulkan_enable2 by name; null for another name.
PFN_xrVoidFunction vulkan2Function(std::string_view name);

}  // namespace sim2vr::openxr

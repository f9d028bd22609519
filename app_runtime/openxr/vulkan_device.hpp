// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vulkan/vulkan_core.h>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "graphics.hpp"
#include "vulkan_functions.hpp"

namespace sim2vr::openxr {

struct VulkanBinding {
  PFN_vkGetInstanceProcAddr lookup;
  VkInstance instance;
  VkPhysicalDevice physical_device;
  VkDevice device;
  std::uint32_t queue_family;
  std::uint32_t queue_index;
};

/// Throws GraphicsError that names `call` unless `result` is VK_SUCCESS.
void checkVk(VkResult result, std::string_view call);

class VulkanDevice {
 public:
  explicit VulkanDevice(const VulkanBinding& binding);
  ~VulkanDevice();
  VulkanDevice(const VulkanDevice&) = delete;
  VulkanDevice& operator=(const VulkanDevice&) = delete;

  VkDevice handle() const { return binding_.device; }
  VkPhysicalDevice physical() const { return binding_.physical_device; }

  /// Memory for an image or buffer, of a type that has `wanted` properties.
  VkDeviceMemory allocate(const VkMemoryRequirements& needs, VkMemoryPropertyFlags wanted) const;

  /// Waits for the last submission, then starts to record. Only where the runtime may use the
  /// program's queue.
  VkCommandBuffer begin();
  /// Submits what was recorded after begin(); wait() tells when it is done.
  void submit();
  /// Returns when the last submission has finished.
  void wait();

  /// A buffer of at least `bytes` that the CPU reads. Contents are lost when it grows; call it
  /// only while nothing is submitted.
  VkBuffer staging(std::size_t bytes);
  /// What the last submission wrote into the staging buffer; call after wait().
  const std::byte* staged() const;

  const VulkanFunctions vk;

 private:
  void release() noexcept;
  void releaseStaging() noexcept;

  VulkanBinding binding_;
  VkPhysicalDeviceMemoryProperties memory_{};
  VkQueue queue_ = VK_NULL_HANDLE;
  VkCommandPool pool_ = VK_NULL_HANDLE;
  VkCommandBuffer commands_ = VK_NULL_HANDLE;
  VkFence fence_ = VK_NULL_HANDLE;
  bool pending_ = false;
  VkBuffer staging_ = VK_NULL_HANDLE;
  VkDeviceMemory staging_memory_ = VK_NULL_HANDLE;
  std::size_t staging_bytes_ = 0;
  void* mapped_ = nullptr;
};

// What the runtime learns of the program's Vulkan instances before there is a session, and the
// functions of XR_KHR_vulkan_enable and XR_KHR_vulkan_enable2 by which it does.

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

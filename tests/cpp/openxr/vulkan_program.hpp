// SPDX-License-Identifier: Apache-2.0
// A program in small that draws with Vulkan: its own instance and device (made through
// XR_KHR_vulkan_enable2), one queue, and the validation layer where it is installed.
#pragma once

#define VK_NO_PROTOTYPES
#include <vulkan/vulkan_core.h>

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "graphics.hpp"

namespace sim2vr::openxr {

class VulkanProgram {
 public:
  /// Text: why there is no device here.
  static std::optional<std::string> start(std::unique_ptr<VulkanProgram>& program);
  explicit VulkanProgram(PFN_vkGetInstanceProcAddr lookup);
  ~VulkanProgram();
  VulkanProgram(const VulkanProgram&) = delete;
  VulkanProgram& operator=(const VulkanProgram&) = delete;

  std::unique_ptr<Graphics> graphics() const;

  /// Clears one layer of an image that is in its attachment layout, as a program leaves it.
  void clearColor(VkImage image, std::uint32_t layer, const std::array<float, 4>& color) const;
  void clearDepth(VkImage image, VkImageAspectFlags aspects, float depth) const;
  /// Copies bytes (rows of the whole image, from the top) into a layer.
  void upload(VkImage image, std::uint32_t layer, VkExtent2D extent,
              const std::vector<std::uint8_t>& bytes) const;

  /// Errors that the validation layer reported; empty too where it is not installed.
  std::vector<std::string> complaints;
  bool validated = false;

  VkInstance instance = VK_NULL_HANDLE;
  VkPhysicalDevice physical_device = VK_NULL_HANDLE;
  VkDevice device = VK_NULL_HANDLE;

 private:
  template <class Function>
  Function function(const char* name) const;
  void createInstance();
  void createDevice();
  void listen();
  template <class Record>
  void run(VkImage image, VkImageAspectFlags aspects, const Record& record) const;

  PFN_vkGetInstanceProcAddr lookup_;
  VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
  VkQueue queue_ = VK_NULL_HANDLE;
  VkCommandPool pool_ = VK_NULL_HANDLE;
};

}  // namespace sim2vr::openxr

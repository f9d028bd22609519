// SPDX-License-Identifier: Apache-2.0
// The Vulkan functions that the runtime calls on the program's own instance and device.
#pragma once

#include <vulkan/vulkan_core.h>

#define SIM2VR_XR_VK_INSTANCE_FUNCTIONS(X)  \
  X(GetDeviceProcAddr)                      \
  X(GetPhysicalDeviceImageFormatProperties) \
  X(GetPhysicalDeviceMemoryProperties)      \
  X(GetPhysicalDeviceQueueFamilyProperties)

#define SIM2VR_XR_VK_DEVICE_FUNCTIONS(X) \
  X(AllocateCommandBuffers)              \
  X(AllocateMemory)                      \
  X(BeginCommandBuffer)                  \
  X(BindBufferMemory)                    \
  X(BindImageMemory)                     \
  X(CmdCopyImageToBuffer)                \
  X(CmdPipelineBarrier)                  \
  X(CmdResolveImage)                     \
  X(CreateBuffer)                        \
  X(CreateCommandPool)                   \
  X(CreateFence)                         \
  X(CreateImage)                         \
  X(DestroyBuffer)                       \
  X(DestroyCommandPool)                  \
  X(DestroyFence)                        \
  X(DestroyImage)                        \
  X(EndCommandBuffer)                    \
  X(FreeMemory)                          \
  X(GetBufferMemoryRequirements)         \
  X(GetDeviceQueue)                      \
  X(GetImageMemoryRequirements)          \
  X(InvalidateMappedMemoryRanges)        \
  X(MapMemory)                           \
  X(QueueSubmit)                         \
  X(ResetFences)                         \
  X(WaitForFences)

namespace sim2vr::openxr {

struct VulkanFunctions {
  /// Fills the table; throws GraphicsError that names the first missing function.
  VulkanFunctions(PFN_vkGetInstanceProcAddr lookup, VkInstance instance, VkDevice device);

#define SIM2VR_XR_VK_MEMBER(name) PFN_vk##name name = nullptr;
  SIM2VR_XR_VK_INSTANCE_FUNCTIONS(SIM2VR_XR_VK_MEMBER)
  SIM2VR_XR_VK_DEVICE_FUNCTIONS(SIM2VR_XR_VK_MEMBER)
#undef SIM2VR_XR_VK_MEMBER
};

}  // namespace sim2vr::openxr

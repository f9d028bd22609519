// SPDX-License-Identifier: Apache-2.0
#include "vulkan_device.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <optional>

namespace sim2vr::openxr {
namespace {

constexpr std::uint64_t kWaitNs = 10'000'000'000;

template <class Function>
void found(Function& function, PFN_vkVoidFunction address, const char* name) {
  function = reinterpret_cast<Function>(address);
  if (function == nullptr) {
    throw GraphicsError(XR_ERROR_GRAPHICS_DEVICE_INVALID,
                        fmt::format("the program's Vulkan has no {}", name));
  }
}

/// The memory type with all `wanted` properties and the most of `liked`.
std::optional<std::uint32_t> memoryType(const VkPhysicalDeviceMemoryProperties& memory,
                                        std::uint32_t allowed, VkMemoryPropertyFlags wanted,
                                        VkMemoryPropertyFlags liked) {
  std::optional<std::uint32_t> best;
  int best_score = -1;
  for (std::uint32_t i = 0; i < memory.memoryTypeCount; ++i) {
    const VkMemoryPropertyFlags flags = memory.memoryTypes[i].propertyFlags;
    const int score = std::popcount(flags & liked);
    const bool usable = (allowed & (1U << i)) != 0 && (flags & wanted) == wanted;
    if (!usable || score <= best_score) continue;
    best = i;
    best_score = score;
  }
  return best;
}

}  // namespace

VulkanFunctions::VulkanFunctions(PFN_vkGetInstanceProcAddr lookup, VkInstance instance,
                                 VkDevice device) {
#define SIM2VR_XR_VK_FIND(name) found(name, lookup(instance, "vk" #name), "vk" #name);
  SIM2VR_XR_VK_INSTANCE_FUNCTIONS(SIM2VR_XR_VK_FIND)
#undef SIM2VR_XR_VK_FIND
#define SIM2VR_XR_VK_FIND(name) found(name, GetDeviceProcAddr(device, "vk" #name), "vk" #name);
  SIM2VR_XR_VK_DEVICE_FUNCTIONS(SIM2VR_XR_VK_FIND)
#undef SIM2VR_XR_VK_FIND
}

void checkVk(VkResult result, std::string_view call) {
  if (result == VK_SUCCESS) return;
  const bool memory =
      result == VK_ERROR_OUT_OF_HOST_MEMORY || result == VK_ERROR_OUT_OF_DEVICE_MEMORY;
  throw GraphicsError(memory ? XR_ERROR_OUT_OF_MEMORY : XR_ERROR_RUNTIME_FAILURE,
                      fmt::format("{} on the program's device returns VkResult {}", call,
                                  static_cast<int>(result)));
}

VulkanDevice::VulkanDevice(const VulkanBinding& binding)
    : vk(binding.lookup, binding.instance, binding.device), binding_(binding) {
  std::uint32_t families = 0;
  vk.GetPhysicalDeviceQueueFamilyProperties(physical(), &families, nullptr);
  if (binding.queue_family >= families) {
    throw GraphicsError(XR_ERROR_GRAPHICS_DEVICE_INVALID,
                        fmt::format("queueFamilyIndex is {}, expected less than {}",
                                    binding.queue_family, families));
  }
  vk.GetPhysicalDeviceMemoryProperties(physical(), &memory_);
  vk.GetDeviceQueue(handle(), binding.queue_family, binding.queue_index, &queue_);
  try {
    VkCommandPoolCreateInfo pool{};
    pool.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO;
    pool.flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT;
    pool.queueFamilyIndex = binding.queue_family;
    checkVk(vk.CreateCommandPool(handle(), &pool, nullptr, &pool_), "vkCreateCommandPool");
    VkCommandBufferAllocateInfo commands{};
    commands.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO;
    commands.commandPool = pool_;
    commands.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
    commands.commandBufferCount = 1;
    checkVk(vk.AllocateCommandBuffers(handle(), &commands, &commands_), "vkAllocateCommandBuffers");
    VkFenceCreateInfo fence{};
    fence.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO;
    checkVk(vk.CreateFence(handle(), &fence, nullptr, &fence_), "vkCreateFence");
  } catch (...) {
    release();
    throw;
  }
}

VulkanDevice::~VulkanDevice() {
  if (pending_) vk.WaitForFences(handle(), 1, &fence_, VK_TRUE, kWaitNs);
  release();
}

void VulkanDevice::release() noexcept {
  releaseStaging();
  vk.DestroyFence(handle(), fence_, nullptr);
  vk.DestroyCommandPool(handle(), pool_, nullptr);
}

void VulkanDevice::releaseStaging() noexcept {
  vk.DestroyBuffer(handle(), staging_, nullptr);
  vk.FreeMemory(handle(), staging_memory_, nullptr);  // unmaps it
  staging_ = VK_NULL_HANDLE;
  staging_memory_ = VK_NULL_HANDLE;
  staging_bytes_ = 0;
  mapped_ = nullptr;
}

VkDeviceMemory VulkanDevice::allocate(const VkMemoryRequirements& needs,
                                      VkMemoryPropertyFlags wanted) const {
  const bool for_cpu = (wanted & VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT) != 0;
  // Reading from memory that is not cached is slow.
  const auto type = memoryType(
      memory_, needs.memoryTypeBits, wanted,
      for_cpu ? VK_MEMORY_PROPERTY_HOST_CACHED_BIT : VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT);
  if (!type.has_value()) {
    throw GraphicsError(XR_ERROR_RUNTIME_FAILURE, "the program's device has no fitting memory");
  }
  VkMemoryAllocateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO;
  info.allocationSize = needs.size;
  info.memoryTypeIndex = *type;
  VkDeviceMemory memory = VK_NULL_HANDLE;
  checkVk(vk.AllocateMemory(handle(), &info, nullptr, &memory), "vkAllocateMemory");
  return memory;
}

VkCommandBuffer VulkanDevice::begin() {
  wait();
  VkCommandBufferBeginInfo info{};
  info.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
  info.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
  checkVk(vk.BeginCommandBuffer(commands_, &info), "vkBeginCommandBuffer");
  return commands_;
}

void VulkanDevice::submit() {
  checkVk(vk.EndCommandBuffer(commands_), "vkEndCommandBuffer");
  checkVk(vk.ResetFences(handle(), 1, &fence_), "vkResetFences");
  VkSubmitInfo info{};
  info.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO;
  info.commandBufferCount = 1;
  info.pCommandBuffers = &commands_;
  checkVk(vk.QueueSubmit(queue_, 1, &info, fence_), "vkQueueSubmit");
  pending_ = true;
}

void VulkanDevice::wait() {
  if (!pending_) return;
  const VkResult result = vk.WaitForFences(handle(), 1, &fence_, VK_TRUE, kWaitNs);
  if (result == VK_TIMEOUT) {
    throw GraphicsError(XR_ERROR_RUNTIME_FAILURE,
                        "the program's queue did not finish its work within 10 s");
  }
  pending_ = false;
  checkVk(result, "vkWaitForFences");
}

VkBuffer VulkanDevice::staging(std::size_t bytes) {
  if (bytes <= staging_bytes_) return staging_;
  releaseStaging();
  VkBufferCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO;
  info.size = bytes;
  info.usage = VK_BUFFER_USAGE_TRANSFER_DST_BIT;
  info.sharingMode = VK_SHARING_MODE_EXCLUSIVE;
  checkVk(vk.CreateBuffer(handle(), &info, nullptr, &staging_), "vkCreateBuffer");
  VkMemoryRequirements needs{};
  vk.GetBufferMemoryRequirements(handle(), staging_, &needs);
  staging_memory_ = allocate(needs, VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT);
  checkVk(vk.BindBufferMemory(handle(), staging_, staging_memory_, 0), "vkBindBufferMemory");
  checkVk(vk.MapMemory(handle(), staging_memory_, 0, VK_WHOLE_SIZE, 0, &mapped_), "vkMapMemory");
  staging_bytes_ = bytes;
  return staging_;
}

const std::byte* VulkanDevice::staged() const {
  VkMappedMemoryRange range{};
  range.sType = VK_STRUCTURE_TYPE_MAPPED_MEMORY_RANGE;
  range.memory = staging_memory_;
  range.size = VK_WHOLE_SIZE;
  checkVk(vk.InvalidateMappedMemoryRanges(handle(), 1, &range), "vkInvalidateMappedMemoryRanges");
  return static_cast<const std::byte*>(mapped_);
}

}  // namespace sim2vr::openxr

// SPDX-License-Identifier: Apache-2.0
#include "vulkan_program.hpp"

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <cstring>
#include <string_view>

#define XR_USE_GRAPHICS_API_VULKAN
#include <openxr/openxr_platform.h>

#include "graphics.hpp"
#include "typed.hpp"
#include "vulkan_device.hpp"

namespace sim2vr::openxr {
namespace {

VKAPI_ATTR VkBool32 VKAPI_CALL complain(VkDebugUtilsMessageSeverityFlagBitsEXT,
                                        VkDebugUtilsMessageTypeFlagsEXT,
                                        const VkDebugUtilsMessengerCallbackDataEXT* data,
                                        void* program) {
  static_cast<VulkanProgram*>(program)->complaints.emplace_back(data->pMessage);
  return VK_FALSE;
}

template <class Function>
Function xr(const char* name) {
  const auto found = reinterpret_cast<Function>(vulkan2Function(name));
  if (found == nullptr) ADD_FAILURE() << "no " << name;
  return found;
}

}  // namespace

template <class Function>
Function VulkanProgram::function(const char* name) const {
  return reinterpret_cast<Function>(lookup_(instance, name));
}

std::optional<std::string> VulkanProgram::start(std::unique_ptr<VulkanProgram>& program) {
  void* library = dlopen("libvulkan.so.1", RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) return dlerror();
  // What Mesa's driver leaks has a name for LeakSanitizer only while it is loaded.
  dlopen("libvulkan_lvp.so", RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  program = std::make_unique<VulkanProgram>(
      reinterpret_cast<PFN_vkGetInstanceProcAddr>(dlsym(library, "vkGetInstanceProcAddr")));
  if (program->device == VK_NULL_HANDLE) return "Vulkan has no device";
  return std::nullopt;
}

VulkanProgram::VulkanProgram(PFN_vkGetInstanceProcAddr lookup) : lookup_(lookup) {
  createInstance();
  if (instance == VK_NULL_HANDLE) return;
  if (validated) listen();
  auto info = typed<XrVulkanGraphicsDeviceGetInfoKHR>(XR_TYPE_VULKAN_GRAPHICS_DEVICE_GET_INFO_KHR);
  info.systemId = 1;
  info.vulkanInstance = instance;
  const auto get = xr<PFN_xrGetVulkanGraphicsDevice2KHR>("xrGetVulkanGraphicsDevice2KHR");
  if (get(XR_NULL_HANDLE, &info, &physical_device) == XR_SUCCESS) createDevice();
}

void VulkanProgram::createInstance() {
  const auto layers =
      function<PFN_vkEnumerateInstanceLayerProperties>("vkEnumerateInstanceLayerProperties");
  std::uint32_t count = 0;
  layers(&count, nullptr);
  std::vector<VkLayerProperties> found(count);
  layers(&count, found.data());
  const char* layer = "VK_LAYER_KHRONOS_validation";
  const char* extension = "VK_EXT_debug_utils";
  for (const auto& one : found) validated |= std::string_view(one.layerName) == layer;
  VkApplicationInfo application{};
  application.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO;
  application.apiVersion = VK_API_VERSION_1_0;
  VkInstanceCreateInfo wanted{};
  wanted.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO;
  wanted.pApplicationInfo = &application;
  wanted.enabledLayerCount = validated ? 1 : 0;
  wanted.ppEnabledLayerNames = &layer;
  wanted.enabledExtensionCount = validated ? 1 : 0;
  wanted.ppEnabledExtensionNames = &extension;
  auto info = typed<XrVulkanInstanceCreateInfoKHR>(XR_TYPE_VULKAN_INSTANCE_CREATE_INFO_KHR);
  info.systemId = 1;
  info.pfnGetInstanceProcAddr = lookup_;
  info.vulkanCreateInfo = &wanted;
  VkResult result = VK_ERROR_UNKNOWN;
  const auto create = xr<PFN_xrCreateVulkanInstanceKHR>("xrCreateVulkanInstanceKHR");
  EXPECT_EQ(create(XR_NULL_HANDLE, &info, &instance, &result), XR_SUCCESS);
  if (result != VK_SUCCESS) instance = VK_NULL_HANDLE;
}

void VulkanProgram::listen() {
  VkDebugUtilsMessengerCreateInfoEXT info{};
  info.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT;
  info.messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT |
                         VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
  info.messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT;
  info.pfnUserCallback = complain;
  info.pUserData = this;
  function<PFN_vkCreateDebugUtilsMessengerEXT>("vkCreateDebugUtilsMessengerEXT")(
      instance, &info, nullptr, &messenger_);
}

void VulkanProgram::createDevice() {
  const float priority = 1.0F;
  VkDeviceQueueCreateInfo queue{};
  queue.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO;
  queue.queueCount = 1;
  queue.pQueuePriorities = &priority;
  VkDeviceCreateInfo wanted{};
  wanted.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO;
  wanted.queueCreateInfoCount = 1;
  wanted.pQueueCreateInfos = &queue;
  auto info = typed<XrVulkanDeviceCreateInfoKHR>(XR_TYPE_VULKAN_DEVICE_CREATE_INFO_KHR);
  info.systemId = 1;
  info.pfnGetInstanceProcAddr = lookup_;
  info.vulkanPhysicalDevice = physical_device;
  info.vulkanCreateInfo = &wanted;
  VkResult result = VK_ERROR_UNKNOWN;
  const auto create = xr<PFN_xrCreateVulkanDeviceKHR>("xrCreateVulkanDeviceKHR");
  EXPECT_EQ(create(XR_NULL_HANDLE, &info, &device, &result), XR_SUCCESS);
  ASSERT_EQ(result, VK_SUCCESS);
  function<PFN_vkGetDeviceQueue>("vkGetDeviceQueue")(device, 0, 0, &queue_);
  VkCommandPoolCreateInfo pool{};
  pool.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO;
  ASSERT_EQ(
      function<PFN_vkCreateCommandPool>("vkCreateCommandPool")(device, &pool, nullptr, &pool_),
      VK_SUCCESS);
}

VulkanProgram::~VulkanProgram() {
  if (device != VK_NULL_HANDLE) {
    function<PFN_vkDestroyCommandPool>("vkDestroyCommandPool")(device, pool_, nullptr);
    function<PFN_vkDestroyDevice>("vkDestroyDevice")(device, nullptr);
  }
  // What is not destroyed by now is reported, so the messenger goes last.
  EXPECT_EQ(complaints, std::vector<std::string>{});
  if (messenger_ != VK_NULL_HANDLE) {
    function<PFN_vkDestroyDebugUtilsMessengerEXT>("vkDestroyDebugUtilsMessengerEXT")(
        instance, messenger_, nullptr);
  }
  if (instance != VK_NULL_HANDLE) {
    function<PFN_vkDestroyInstance>("vkDestroyInstance")(instance, nullptr);
  }
}

std::unique_ptr<Graphics> VulkanProgram::graphics() const {
  auto binding = typed<XrGraphicsBindingVulkanKHR>(XR_TYPE_GRAPHICS_BINDING_VULKAN_KHR);
  binding.instance = instance;
  binding.physicalDevice = physical_device;
  binding.device = device;
  return vulkan2Maker().create(reinterpret_cast<const XrBaseInStructure&>(binding));
}

/// Records in the layout for copies, submits, waits, and leaves the layout of attachments.
template <class Record>
void VulkanProgram::run(VkImage image, VkImageAspectFlags aspects, const Record& record) const {
  VkCommandBufferAllocateInfo allocate{};
  allocate.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO;
  allocate.commandPool = pool_;
  allocate.commandBufferCount = 1;
  VkCommandBuffer commands = VK_NULL_HANDLE;
  function<PFN_vkAllocateCommandBuffers>("vkAllocateCommandBuffers")(device, &allocate, &commands);
  VkCommandBufferBeginInfo begin{};
  begin.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
  function<PFN_vkBeginCommandBuffer>("vkBeginCommandBuffer")(commands, &begin);
  VkImageMemoryBarrier barrier{};
  barrier.sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER;
  barrier.srcAccessMask = VK_ACCESS_MEMORY_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
  barrier.oldLayout = aspects == VK_IMAGE_ASPECT_COLOR_BIT
                          ? VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL
                          : VK_IMAGE_LAYOUT_DEPTH_STENCIL_ATTACHMENT_OPTIMAL;
  barrier.newLayout = VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL;
  barrier.srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  barrier.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  barrier.image = image;
  barrier.subresourceRange = {aspects, 0, VK_REMAINING_MIP_LEVELS, 0, VK_REMAINING_ARRAY_LAYERS};
  const auto wait = function<PFN_vkCmdPipelineBarrier>("vkCmdPipelineBarrier");
  const VkPipelineStageFlags all = VK_PIPELINE_STAGE_ALL_COMMANDS_BIT;
  wait(commands, all, all, 0, 0, nullptr, 0, nullptr, 1, &barrier);
  record(commands);
  std::swap(barrier.oldLayout, barrier.newLayout);
  barrier.srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_MEMORY_WRITE_BIT;
  wait(commands, all, all, 0, 0, nullptr, 0, nullptr, 1, &barrier);
  function<PFN_vkEndCommandBuffer>("vkEndCommandBuffer")(commands);
  VkSubmitInfo submit{};
  submit.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO;
  submit.commandBufferCount = 1;
  submit.pCommandBuffers = &commands;
  EXPECT_EQ(function<PFN_vkQueueSubmit>("vkQueueSubmit")(queue_, 1, &submit, VK_NULL_HANDLE),
            VK_SUCCESS);
  EXPECT_EQ(function<PFN_vkQueueWaitIdle>("vkQueueWaitIdle")(queue_), VK_SUCCESS);
  function<PFN_vkFreeCommandBuffers>("vkFreeCommandBuffers")(device, pool_, 1, &commands);
}

void VulkanProgram::clearColor(VkImage image, std::uint32_t layer,
                               const std::array<float, 4>& color) const {
  run(image, VK_IMAGE_ASPECT_COLOR_BIT, [&](VkCommandBuffer commands) {
    VkClearColorValue value{};
    std::memcpy(value.float32, color.data(), sizeof(value.float32));
    const VkImageSubresourceRange range = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, layer, 1};
    function<PFN_vkCmdClearColorImage>("vkCmdClearColorImage")(
        commands, image, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, &value, 1, &range);
  });
}

void VulkanProgram::clearDepth(VkImage image, VkImageAspectFlags aspects, float depth) const {
  run(image, aspects, [&](VkCommandBuffer commands) {
    const VkClearDepthStencilValue value = {depth, 0};
    const VkImageSubresourceRange range = {VK_IMAGE_ASPECT_DEPTH_BIT, 0, 1, 0, 1};
    function<PFN_vkCmdClearDepthStencilImage>("vkCmdClearDepthStencilImage")(
        commands, image, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, &value, 1, &range);
  });
}

void VulkanProgram::upload(VkImage image, std::uint32_t layer, VkExtent2D extent,
                           const std::vector<std::uint8_t>& bytes) const {
  VkBufferCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO;
  info.size = bytes.size();
  info.usage = VK_BUFFER_USAGE_TRANSFER_SRC_BIT;
  VkBuffer buffer = VK_NULL_HANDLE;
  function<PFN_vkCreateBuffer>("vkCreateBuffer")(device, &info, nullptr, &buffer);
  VkMemoryRequirements needs{};
  function<PFN_vkGetBufferMemoryRequirements>("vkGetBufferMemoryRequirements")(device, buffer,
                                                                               &needs);
  VkPhysicalDeviceMemoryProperties types{};
  function<PFN_vkGetPhysicalDeviceMemoryProperties>("vkGetPhysicalDeviceMemoryProperties")(
      physical_device, &types);
  const VkMemoryPropertyFlags wanted =
      VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
  VkMemoryAllocateInfo allocate{};
  allocate.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO;
  allocate.allocationSize = needs.size;
  while ((types.memoryTypes[allocate.memoryTypeIndex].propertyFlags & wanted) != wanted) {
    ++allocate.memoryTypeIndex;
  }
  VkDeviceMemory memory = VK_NULL_HANDLE;
  function<PFN_vkAllocateMemory>("vkAllocateMemory")(device, &allocate, nullptr, &memory);
  function<PFN_vkBindBufferMemory>("vkBindBufferMemory")(device, buffer, memory, 0);
  void* mapped = nullptr;
  function<PFN_vkMapMemory>("vkMapMemory")(device, memory, 0, VK_WHOLE_SIZE, 0, &mapped);
  std::memcpy(mapped, bytes.data(), bytes.size());
  run(image, VK_IMAGE_ASPECT_COLOR_BIT, [&](VkCommandBuffer commands) {
    VkBufferImageCopy region{};
    region.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, layer, 1};
    region.imageExtent = {extent.width, extent.height, 1};
    function<PFN_vkCmdCopyBufferToImage>("vkCmdCopyBufferToImage")(
        commands, buffer, image, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, 1, &region);
  });
  function<PFN_vkDestroyBuffer>("vkDestroyBuffer")(device, buffer, nullptr);
  function<PFN_vkFreeMemory>("vkFreeMemory")(device, memory, nullptr);
}

}  // namespace sim2vr::openxr

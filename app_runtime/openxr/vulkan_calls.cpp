// SPDX-License-Identifier: Apache-2.0
#include "vulkan_device.hpp"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <vector>

#define XR_USE_GRAPHICS_API_VULKAN
#include <openxr/openxr_platform.h>

namespace sim2vr::openxr {
namespace {

constexpr const char* kLegacy = XR_KHR_VULKAN_ENABLE_EXTENSION_NAME;
constexpr const char* kVulkan2 = XR_KHR_VULKAN_ENABLE2_EXTENSION_NAME;

struct Registry {
  std::mutex mutex;
  std::map<VkInstance, VulkanInstance> instances;
};

Registry& registry() {
  static Registry made;
  return made;
}

PFN_vkGetInstanceProcAddr libraryLookup() {
  // The same library as the program's: the loader is found by its soname.
  void* library = dlopen("libvulkan.so.1", RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) throw GraphicsError(XR_ERROR_RUNTIME_FAILURE, dlerror());
  return reinterpret_cast<PFN_vkGetInstanceProcAddr>(dlsym(library, "vkGetInstanceProcAddr"));
}

template <class Function>
Function instanceFunction(PFN_vkGetInstanceProcAddr lookup, VkInstance instance, const char* name) {
  auto function = reinterpret_cast<Function>(lookup(instance, name));
  if (function == nullptr) {
    throw GraphicsError(XR_ERROR_RUNTIME_FAILURE,
                        fmt::format("the program's Vulkan has no {}", name));
  }
  return function;
}

/// A GPU before a driver on the CPU; of two alike the one that Vulkan lists first.
int preference(VkPhysicalDeviceType type) {
  switch (type) {
    case VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU:
      return 4;
    case VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU:
      return 3;
    case VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU:
      return 2;
    case VK_PHYSICAL_DEVICE_TYPE_CPU:
      return 1;
    default:
      return 0;
  }
}

VkPhysicalDevice choosePhysicalDevice(VkInstance instance) {
  const VulkanInstance known = findVulkanInstance(instance);
  const auto enumerate = instanceFunction<PFN_vkEnumeratePhysicalDevices>(
      known.lookup, instance, "vkEnumeratePhysicalDevices");
  const auto properties = instanceFunction<PFN_vkGetPhysicalDeviceProperties>(
      known.lookup, instance, "vkGetPhysicalDeviceProperties");
  std::uint32_t count = 0;
  enumerate(instance, &count, nullptr);
  std::vector<VkPhysicalDevice> devices(count);
  enumerate(instance, &count, devices.data());
  devices.resize(count);
  const auto rank = [&](VkPhysicalDevice device) {
    VkPhysicalDeviceProperties found{};
    properties(device, &found);
    return preference(found.deviceType);
  };
  const auto best =
      std::max_element(devices.begin(), devices.end(),
                       [&](VkPhysicalDevice a, VkPhysicalDevice b) { return rank(a) < rank(b); });
  if (best == devices.end()) {
    throw GraphicsError(XR_ERROR_RUNTIME_FAILURE,
                        "Vulkan has no device (package mesa-vulkan-drivers has one for the CPU)");
  }
  Registry& all = registry();
  const std::lock_guard lock(all.mutex);
  all.instances[instance] = {known.lookup, *best};
  return *best;
}

/// Runs `work`; what it throws becomes the call's result.
template <class Work>
XrResult guarded(const char* call, const Work& work) {
  try {
    return work();
  } catch (const GraphicsError& error) {
    return graphicsFailed(call, error.result(), error.what());
  } catch (const std::exception& error) {
    return graphicsFailed(call, XR_ERROR_RUNTIME_FAILURE, error.what());
  }
}

XrResult invalid(const char* call, std::string_view cause) {
  return graphicsFailed(call, XR_ERROR_VALIDATION_FAILURE, cause);
}

XrResult graphicsDevice(const char* call, VkInstance instance, VkPhysicalDevice* device) {
  if (instance == VK_NULL_HANDLE || device == nullptr) {
    return invalid(call, "the VkInstance or the place for the VkPhysicalDevice is null");
  }
  return guarded(call, [&] {
    *device = choosePhysicalDevice(instance);
    return XR_SUCCESS;
  });
}

XrResult requirements(const char* call, XrGraphicsRequirementsVulkanKHR* wanted) {
  if (wanted == nullptr || wanted->type != XR_TYPE_GRAPHICS_REQUIREMENTS_VULKAN_KHR) {
    return invalid(call, "graphicsRequirements is not a XrGraphicsRequirementsVulkanKHR");
  }
  wanted->minApiVersionSupported = XR_MAKE_VERSION(1, 0, 0);
  wanted->maxApiVersionSupported = XR_MAKE_VERSION(1, 3, 0xFFFFFFFF);
  return XR_SUCCESS;
}

/// Images on the program's own device need no extension: the list is the empty string.
XrResult noExtensions(const char* call, std::uint32_t capacity, std::uint32_t* count,
                      char* buffer) {
  if (count == nullptr || (capacity > 0 && buffer == nullptr)) {
    return invalid(call, "bufferCountOutput or buffer is null");
  }
  *count = 1;
  if (capacity > 0) *buffer = '\0';
  return XR_SUCCESS;
}

XrResult XRAPI_CALL getVulkanInstanceExtensions(XrInstance instance, XrSystemId system,
                                                std::uint32_t capacity, std::uint32_t* count,
                                                char* buffer) {
  constexpr const char* kCall = "xrGetVulkanInstanceExtensionsKHR";
  const XrResult result = graphicsCall(kCall, instance, system, kLegacy);
  return result == XR_SUCCESS ? noExtensions(kCall, capacity, count, buffer) : result;
}

XrResult XRAPI_CALL getVulkanDeviceExtensions(XrInstance instance, XrSystemId system,
                                              std::uint32_t capacity, std::uint32_t* count,
                                              char* buffer) {
  constexpr const char* kCall = "xrGetVulkanDeviceExtensionsKHR";
  const XrResult result = graphicsCall(kCall, instance, system, kLegacy);
  return result == XR_SUCCESS ? noExtensions(kCall, capacity, count, buffer) : result;
}

XrResult XRAPI_CALL getVulkanGraphicsDevice(XrInstance instance, XrSystemId system,
                                            VkInstance vk_instance, VkPhysicalDevice* device) {
  constexpr const char* kCall = "xrGetVulkanGraphicsDeviceKHR";
  const XrResult result = graphicsCall(kCall, instance, system, kLegacy);
  return result == XR_SUCCESS ? graphicsDevice(kCall, vk_instance, device) : result;
}

XrResult XRAPI_CALL getVulkanGraphicsRequirements(XrInstance instance, XrSystemId system,
                                                  XrGraphicsRequirementsVulkanKHR* wanted) {
  constexpr const char* kCall = "xrGetVulkanGraphicsRequirementsKHR";
  const XrResult result = graphicsCall(kCall, instance, system, kLegacy);
  return result == XR_SUCCESS ? requirements(kCall, wanted) : result;
}

XrResult XRAPI_CALL getVulkanGraphicsRequirements2(XrInstance instance, XrSystemId system,
                                                   XrGraphicsRequirementsVulkanKHR* wanted) {
  constexpr const char* kCall = "xrGetVulkanGraphicsRequirements2KHR";
  const XrResult result = graphicsCall(kCall, instance, system, kVulkan2);
  return result == XR_SUCCESS ? requirements(kCall, wanted) : result;
}

XrResult XRAPI_CALL getVulkanGraphicsDevice2(XrInstance instance,
                                             const XrVulkanGraphicsDeviceGetInfoKHR* info,
                                             VkPhysicalDevice* device) {
  constexpr const char* kCall = "xrGetVulkanGraphicsDevice2KHR";
  if (info == nullptr || info->type != XR_TYPE_VULKAN_GRAPHICS_DEVICE_GET_INFO_KHR) {
    return invalid(kCall, "getInfo is not a XrVulkanGraphicsDeviceGetInfoKHR");
  }
  const XrResult result = graphicsCall(kCall, instance, info->systemId, kVulkan2);
  return result == XR_SUCCESS ? graphicsDevice(kCall, info->vulkanInstance, device) : result;
}

/// What the calls that create something of Vulkan check alike.
template <class Info>
XrResult creating(const char* call, XrInstance instance, const Info* info, XrStructureType type,
                  bool has_places) {
  if (info == nullptr || info->type != type || info->createFlags != 0 ||
      info->pfnGetInstanceProcAddr == nullptr || info->vulkanCreateInfo == nullptr || !has_places) {
    return invalid(call,
                   "an argument is null, createFlags is not 0, or createInfo's type is wrong");
  }
  return graphicsCall(call, instance, info->systemId, kVulkan2);
}

XrResult XRAPI_CALL createVulkanInstance(XrInstance instance,
                                         const XrVulkanInstanceCreateInfoKHR* info,
                                         VkInstance* made, VkResult* vk_result) {
  constexpr const char* kCall = "xrCreateVulkanInstanceKHR";
  const XrResult result = creating(kCall, instance, info, XR_TYPE_VULKAN_INSTANCE_CREATE_INFO_KHR,
                                   made != nullptr && vk_result != nullptr);
  if (result != XR_SUCCESS) return result;
  return guarded(kCall, [&] {
    const auto create = instanceFunction<PFN_vkCreateInstance>(info->pfnGetInstanceProcAddr,
                                                               VK_NULL_HANDLE, "vkCreateInstance");
    *vk_result = create(info->vulkanCreateInfo, info->vulkanAllocator, made);
    if (*vk_result == VK_SUCCESS) {
      Registry& all = registry();
      const std::lock_guard lock(all.mutex);
      all.instances[*made] = {info->pfnGetInstanceProcAddr, VK_NULL_HANDLE};
    }
    return XR_SUCCESS;
  });
}

/// The instance whose graphics device is `device`; null: none.
VkInstance instanceOf(VkPhysicalDevice device) {
  Registry& all = registry();
  const std::lock_guard lock(all.mutex);
  const auto found = std::find_if(all.instances.begin(), all.instances.end(), [&](const auto& one) {
    return one.second.physical_device == device;
  });
  return found == all.instances.end() ? VK_NULL_HANDLE : found->first;
}

XrResult XRAPI_CALL createVulkanDevice(XrInstance instance, const XrVulkanDeviceCreateInfoKHR* info,
                                       VkDevice* made, VkResult* vk_result) {
  constexpr const char* kCall = "xrCreateVulkanDeviceKHR";
  const XrResult result = creating(kCall, instance, info, XR_TYPE_VULKAN_DEVICE_CREATE_INFO_KHR,
                                   made != nullptr && vk_result != nullptr);
  if (result != XR_SUCCESS) return result;
  const VkInstance owner = info->vulkanPhysicalDevice == VK_NULL_HANDLE
                               ? VK_NULL_HANDLE
                               : instanceOf(info->vulkanPhysicalDevice);
  if (owner == VK_NULL_HANDLE) {
    return graphicsFailed(
        kCall, XR_ERROR_HANDLE_INVALID,
        "vulkanPhysicalDevice is not what xrGetVulkanGraphicsDevice2KHR returned");
  }
  return guarded(kCall, [&] {
    const auto create =
        instanceFunction<PFN_vkCreateDevice>(info->pfnGetInstanceProcAddr, owner, "vkCreateDevice");
    *vk_result =
        create(info->vulkanPhysicalDevice, info->vulkanCreateInfo, info->vulkanAllocator, made);
    return XR_SUCCESS;
  });
}

}  // namespace

VulkanInstance findVulkanInstance(VkInstance instance) {
  {
    Registry& all = registry();
    const std::lock_guard lock(all.mutex);
    const auto found = all.instances.find(instance);
    if (found != all.instances.end()) return found->second;
  }
  return {libraryLookup(), VK_NULL_HANDLE};
}

PFN_xrVoidFunction vulkanFunction(std::string_view name) {
  const auto address = [](auto* function) {
    return reinterpret_cast<PFN_xrVoidFunction>(function);
  };
  if (name == "xrGetVulkanInstanceExtensionsKHR") return address(getVulkanInstanceExtensions);
  if (name == "xrGetVulkanDeviceExtensionsKHR") return address(getVulkanDeviceExtensions);
  if (name == "xrGetVulkanGraphicsDeviceKHR") return address(getVulkanGraphicsDevice);
  if (name == "xrGetVulkanGraphicsRequirementsKHR") return address(getVulkanGraphicsRequirements);
  return nullptr;
}

PFN_xrVoidFunction vulkan2Function(std::string_view name) {
  const auto address = [](auto* function) {
    return reinterpret_cast<PFN_xrVoidFunction>(function);
  };
  if (name == "xrCreateVulkanInstanceKHR") return address(createVulkanInstance);
  if (name == "xrCreateVulkanDeviceKHR") return address(createVulkanDevice);
  if (name == "xrGetVulkanGraphicsDevice2KHR") return address(getVulkanGraphicsDevice2);
  if (name == "xrGetVulkanGraphicsRequirements2KHR") return address(getVulkanGraphicsRequirements2);
  return nullptr;
}

}  // namespace sim2vr::openxr

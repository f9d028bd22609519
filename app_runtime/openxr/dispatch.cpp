// SPDX-License-Identifier: Apache-2.0
// Functions by name, and the door through which the loader comes.
#include <algorithm>
#include <array>
#include <cstring>
#include <string_view>

#include "calls.hpp"
#include "check.hpp"
#include "objects.hpp"

namespace sim2vr::openxr {
namespace {

struct Function {
  std::string_view name;
  PFN_xrVoidFunction function;
  /// Empty: core. "1.1": core since 1.1.
  std::string_view needs;
};

template <class F>
PFN_xrVoidFunction plain(F function) {
  return reinterpret_cast<PFN_xrVoidFunction>(function);
}

const auto& functions() {
  static const std::array kFunctions = std::to_array<Function>({
#define SIM2VR_CORE(name) {#name, plain(&calls::name), ""},
      SIM2VR_CORE_CALLS(SIM2VR_CORE)
#undef SIM2VR_CORE
#define SIM2VR_DEBUG(name) {#name, plain(&calls::name), "XR_EXT_debug_utils"},
          SIM2VR_DEBUG_CALLS(SIM2VR_DEBUG)
#undef SIM2VR_DEBUG
              {"xrLocateSpaces", plain(&calls::xrLocateSpaces), "1.1"},
      {"xrLocateSpacesKHR", plain(&calls::xrLocateSpaces), "XR_KHR_locate_spaces"},
      {"xrConvertTimespecTimeToTimeKHR", plain(&calls::xrConvertTimespecTimeToTimeKHR),
       "XR_KHR_convert_timespec_time"},
      {"xrConvertTimeToTimespecTimeKHR", plain(&calls::xrConvertTimeToTimespecTimeKHR),
       "XR_KHR_convert_timespec_time"},
  });
  return kFunctions;
}

/// What works without an instance.
bool isGlobal(std::string_view name) {
  return name == "xrGetInstanceProcAddr" || name == "xrEnumerateInstanceExtensionProperties" ||
         name == "xrCreateInstance";
}

PFN_xrVoidFunction graphicsFunction(const Instance& instance, std::string_view name) {
  for (const GraphicsMaker& maker : graphicsMakers()) {
    if (!instance.enabled(maker.extension) || maker.function == nullptr) continue;
    if (PFN_xrVoidFunction found = maker.function(name)) return found;
  }
  return nullptr;
}

PFN_xrVoidFunction find(const Instance* instance, std::string_view name) {
  for (const Function& each : functions()) {
    if (each.name != name) continue;
    if (isGlobal(name)) return each.function;
    if (instance == nullptr) return nullptr;
    const bool has = each.needs.empty() || (each.needs == "1.1" ? instance->version >= kVersion11
                                                                : instance->enabled(each.needs));
    return has ? each.function : nullptr;
  }
  return instance == nullptr ? nullptr : graphicsFunction(*instance, name);
}

}  // namespace

XrResult XRAPI_CALL calls::xrGetInstanceProcAddr(XrInstance instance, const char* name,
                                                 PFN_xrVoidFunction* function) {
  return guarded("xrGetInstanceProcAddr", [&](Lock&) {
    requirePointer(name, "name");
    requirePointer(function, "function");
    *function = nullptr;
    std::shared_ptr<Instance> owner;
    if (instance != XR_NULL_HANDLE) owner = get<Instance>(instance, "instance");
    *function = find(owner.get(), name);
    if (*function != nullptr) return XR_SUCCESS;
    if (owner == nullptr) {
      throw Failure(XR_ERROR_HANDLE_INVALID, std::string(name) + " needs an instance");
    }
    // Programs and layers ask for all that they might use: no line about it.
    return XR_ERROR_FUNCTION_UNSUPPORTED;
  });
}

}  // namespace sim2vr::openxr

namespace {

// openxr/loader_interfaces.h, which distributions do not ship.
struct NegotiateLoaderInfo {
  std::uint32_t struct_type;
  std::uint32_t struct_version;
  std::size_t struct_size;
  std::uint32_t min_interface_version;
  std::uint32_t max_interface_version;
  XrVersion min_api_version;
  XrVersion max_api_version;
};
struct NegotiateRuntimeRequest {
  std::uint32_t struct_type;
  std::uint32_t struct_version;
  std::size_t struct_size;
  std::uint32_t runtime_interface_version;
  XrVersion runtime_api_version;
  PFN_xrGetInstanceProcAddr get_instance_proc_addr;
};

}  // namespace

extern "C" __attribute__((visibility("default"))) XrResult xrNegotiateLoaderRuntimeInterface(
    const NegotiateLoaderInfo* loader, NegotiateRuntimeRequest* runtime);

XrResult xrNegotiateLoaderRuntimeInterface(const NegotiateLoaderInfo* loader,
                                           NegotiateRuntimeRequest* runtime) {
  using namespace sim2vr::openxr;
  constexpr std::uint32_t kLoaderInfo = 1;
  constexpr std::uint32_t kRuntimeRequest = 3;
  constexpr std::uint32_t kInterface = 1;
  const bool fits =
      loader != nullptr && runtime != nullptr && loader->struct_type == kLoaderInfo &&
      loader->struct_version == 1 && loader->struct_size == sizeof *loader &&
      runtime->struct_type == kRuntimeRequest && runtime->struct_version == 1 &&
      runtime->struct_size == sizeof *runtime && loader->min_interface_version <= kInterface &&
      loader->max_interface_version >= kInterface && loader->min_api_version <= kNewestVersion &&
      loader->max_api_version >= kVersion10;
  if (!fits) {
    return failed("xrNegotiateLoaderRuntimeInterface", XR_ERROR_INITIALIZATION_FAILED,
                  "the loader speaks another interface than version 1");
  }
  runtime->runtime_interface_version = kInterface;
  runtime->runtime_api_version = kNewestVersion;
  runtime->get_instance_proc_addr = &calls::xrGetInstanceProcAddr;
  return XR_SUCCESS;
}

// SPDX-License-Identifier: Apache-2.0
// Instances, their properties and events.
#include <openxr/openxr_reflection.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>

#include "calls.hpp"
#include "check.hpp"
#include "extensions.hpp"
#include "objects.hpp"
#include "session_state.hpp"
#include "sim2vr/core/version.hpp"

namespace sim2vr::openxr {
namespace {

constexpr const char* kRuntimeName = "SIM2VR";

void checkVersion(XrVersion version) {
  const auto major = XR_VERSION_MAJOR(version);
  const auto minor = XR_VERSION_MINOR(version);
  if (major == 1 && minor <= 1) return;
  throw Failure(
      XR_ERROR_API_VERSION_UNSUPPORTED,
      fmt::format("applicationInfo.apiVersion is {}.{}, expected 1.0 or 1.1", major, minor));
}

std::set<std::string, std::less<>> enabledExtensions(const XrInstanceCreateInfo& info) {
  std::set<std::string, std::less<>> enabled;
  if (info.enabledExtensionCount > 0) {
    requirePointer(info.enabledExtensionNames, "createInfo->enabledExtensionNames");
  }
  for (std::uint32_t i = 0; i < info.enabledExtensionCount; ++i) {
    const char* name = info.enabledExtensionNames[i];
    requirePointer(name, "createInfo->enabledExtensionNames[i]");
    const auto& known = extensions();
    const bool has = std::any_of(known.begin(), known.end(),
                                 [&](const Extension& each) { return each.name == name; });
    if (!has) throw Failure(XR_ERROR_EXTENSION_NOT_PRESENT, fmt::format("no extension {}", name));
    enabled.emplace(name);
  }
  return enabled;
}

/// One program speaks over one socket, so that a second instance beside a living one is refused.
void requireAlone() {
  for (const auto& object : world().handles.below(HandleType::instance, 0)) {
    if (static_cast<const Instance&>(*object).harness) {
      throw Failure(XR_ERROR_LIMIT_REACHED, "this process has an instance already");
    }
  }
}

std::shared_ptr<Instance> makeInstance(const XrInstanceCreateInfo& info) {
  const XrApplicationInfo& app = info.applicationInfo;
  checkVersion(app.apiVersion);
  const auto name = boundedText(app.applicationName, "applicationInfo.applicationName");
  const auto engine = boundedText(app.engineName, "applicationInfo.engineName");
  if (name.empty()) {
    throw Failure(XR_ERROR_NAME_INVALID, "applicationInfo.applicationName is empty");
  }
  if (info.createFlags != 0) invalid("createInfo->createFlags is not 0");
  if (info.enabledApiLayerCount > 0) {
    requirePointer(info.enabledApiLayerNames, "createInfo->enabledApiLayerNames");
  }
  auto instance = std::make_shared<Instance>();
  instance->version = app.apiVersion;
  instance->extensions = enabledExtensions(info);
  requireAlone();
  watchForks(-1);
  const Hello hello{std::string(name),   app.applicationVersion,
                    std::string(engine), app.engineVersion,
                    app.apiVersion,      {instance->extensions.begin(), instance->extensions.end()},
                    ::getpid()};
  instance->harness = Harness::connect(hello);
  if (instance->harness) instance->config = instance->harness->config();
  return instance;
}

template <std::size_t N>
void writeName(const char* known, const char* unknown, int value, char (&)[N], char* buffer) {
  char text[N];
  copyText(text, known != nullptr ? std::string(known) : fmt::format("{}{}", unknown, value));
  std::memcpy(buffer, text, N);
}

const char* structureName(XrStructureType type) {
  switch (type) {
#define SIM2VR_STRUCTURE(name, number) \
  case name:                           \
    return #name;
    XR_LIST_ENUM_XrStructureType(SIM2VR_STRUCTURE)
#undef SIM2VR_STRUCTURE
        default : break;
  }
  if (type == kSpacesLocateInfoType) return "XR_TYPE_SPACES_LOCATE_INFO";
  if (type == kSpaceLocationsType) return "XR_TYPE_SPACE_LOCATIONS";
  if (type == kSpaceVelocitiesType) return "XR_TYPE_SPACE_VELOCITIES";
  return nullptr;
}

}  // namespace

XrResult XRAPI_CALL calls::xrEnumerateInstanceExtensionProperties(
    const char* layerName, uint32_t propertyCapacityInput, uint32_t* propertyCountOutput,
    XrExtensionProperties* properties) {
  return guarded("xrEnumerateInstanceExtensionProperties", [&](Lock&) {
    if (layerName != nullptr) {
      throw Failure(XR_ERROR_API_LAYER_NOT_PRESENT, fmt::format("no layer {}", layerName));
    }
    const auto& known = extensions();
    if (!wantsItems(known.size(), propertyCapacityInput, propertyCountOutput, properties,
                    "properties")) {
      return XR_SUCCESS;
    }
    requireTypes(properties, known.size(), XR_TYPE_EXTENSION_PROPERTIES, "properties");
    for (std::size_t i = 0; i < known.size(); ++i) {
      copyText(properties[i].extensionName, known[i].name);
      properties[i].extensionVersion = known[i].version;
    }
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrCreateInstance(const XrInstanceCreateInfo* createInfo,
                                            XrInstance* instance) {
  return guarded("xrCreateInstance", [&](Lock&) {
    const auto& info = structure(createInfo, XR_TYPE_INSTANCE_CREATE_INFO, "createInfo");
    requirePointer(instance, "instance");
    const auto made = makeInstance(info);
    *instance = add<XrInstance>(made, 0);
    if (const auto* messenger = chained<XrDebugUtilsMessengerCreateInfoEXT>(
            info.next, XR_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT)) {
      if (made->enabled("XR_EXT_debug_utils") && messenger->userCallback != nullptr) {
        addMessenger(*made, *messenger);
      }
    }
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrDestroyInstance(XrInstance instance) {
  std::shared_ptr<Instance> removed;
  const XrResult result = guarded("xrDestroyInstance", [&](Lock&) {
    removed = get<Instance>(instance, "instance");
    for (const auto& session : world().handles.below(HandleType::session, removed->handle)) {
      leave(static_cast<Session&>(*session), "xrDestroyInstance");
    }
    if (removed->harness) {
      removed->harness->relax();
      removed->harness->ended("the program destroyed its instance", "xrDestroyInstance");
    }
    world().handles.remove(removed->handle);
    return XR_SUCCESS;
  });
  if (removed && removed->harness) removed->harness->stopWatching();
  return result;
}

XrResult XRAPI_CALL calls::xrGetInstanceProperties(XrInstance instance,
                                                   XrInstanceProperties* instanceProperties) {
  return guarded("xrGetInstanceProperties", [&](Lock&) {
    get<Instance>(instance, "instance");
    auto& to = structure(instanceProperties, XR_TYPE_INSTANCE_PROPERTIES, "instanceProperties");
    unsigned major = 0;
    unsigned minor = 0;
    unsigned patch = 0;
    const std::string version(sim2vr::version());
    std::sscanf(version.c_str(), "%u.%u.%u", &major, &minor, &patch);
    to.runtimeVersion = XR_MAKE_VERSION(major, minor, patch);
    copyText(to.runtimeName, kRuntimeName);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrPollEvent(XrInstance instance, XrEventDataBuffer* eventData) {
  return guarded("xrPollEvent", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    structure(eventData, XR_TYPE_EVENT_DATA_BUFFER, "eventData");
    if (owner->harness && owner->harness->lost()) {
      for (const auto& session : world().handles.below(HandleType::session, owner->handle)) {
        checkHarness(static_cast<Session&>(*session));
      }
    }
    if (owner->events.empty()) return XR_EVENT_UNAVAILABLE;
    *eventData = owner->events.front();
    owner->events.pop_front();
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrResultToString(XrInstance instance, XrResult value,
                                            char buffer[XR_MAX_RESULT_STRING_SIZE]) {
  return guarded("xrResultToString", [&](Lock&) {
    get<Instance>(instance, "instance");
    requirePointer(buffer, "buffer");
    char size[XR_MAX_RESULT_STRING_SIZE];
    writeName(resultName(value), value < 0 ? "XR_UNKNOWN_FAILURE_" : "XR_UNKNOWN_SUCCESS_", value,
              size, buffer);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrStructureTypeToString(XrInstance instance, XrStructureType value,
                                                   char buffer[XR_MAX_STRUCTURE_NAME_SIZE]) {
  return guarded("xrStructureTypeToString", [&](Lock&) {
    get<Instance>(instance, "instance");
    requirePointer(buffer, "buffer");
    char size[XR_MAX_STRUCTURE_NAME_SIZE];
    writeName(structureName(value), "XR_UNKNOWN_STRUCTURE_TYPE_", value, size, buffer);
    return XR_SUCCESS;
  });
}

}  // namespace sim2vr::openxr

// SPDX-License-Identifier: Apache-2.0
// The one system: a headset with two eyes that nothing shines through.
#include "instance.hpp"

#include <openxr/openxr_reflection.h>
#include <unistd.h>
#include <algorithm>
#include <array>
#include <cstring>
#include <ctime>

#include "api.hpp"
#include "calls.hpp"
#include "check.hpp"
#include "session.hpp"
#include "sim2vr/core/version.hpp"

namespace sim2vr::openxr {
namespace {

std::shared_ptr<Instance> withSystem(XrInstance instance, XrSystemId system) {
  auto owner = get<Instance>(instance, "instance");
  if (system != kSystem || !owner->system_asked) {
    throw Failure(XR_ERROR_SYSTEM_INVALID, fmt::format("no system {}", system));
  }
  return owner;
}

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

/// XrTime - CLOCK_MONOTONIC: 0 in real time; in lockstep that of the latest frame.
std::int64_t clockOffset(const Instance& instance) {
  for (const auto& object : world().handles.below(HandleType::session, instance.handle)) {
    return static_cast<const Session&>(*object).monotonic_offset_ns;
  }
  return 0;
}

void noteLabel(Session& session, const XrDebugUtilsLabelEXT* label) {
  const auto& info = structure(label, XR_TYPE_DEBUG_UTILS_LABEL_EXT, "labelInfo");
  requirePointer(info.labelName, "labelInfo->labelName");
  constexpr std::size_t kMaximumLabel = 1000;
  if (Harness* harness = session.instance->harness.get()) {
    harness->note({.kind = "label",
                   .text = std::string(info.labelName, ::strnlen(info.labelName, kMaximumLabel)),
                   .time_ns = session.now()});
  }
}

}  // namespace

void requireStereo(XrViewConfigurationType type) {
  if (type == XR_VIEW_CONFIGURATION_TYPE_PRIMARY_STEREO) return;
  throw Failure(
      XR_ERROR_VIEW_CONFIGURATION_TYPE_UNSUPPORTED,
      fmt::format("view configuration {}, expected PRIMARY_STEREO (2)", static_cast<int>(type)));
}

XrResult XRAPI_CALL calls::xrGetSystem(XrInstance instance, const XrSystemGetInfo* getInfo,
                                       XrSystemId* systemId) {
  return guarded("xrGetSystem", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    const auto& info = structure(getInfo, XR_TYPE_SYSTEM_GET_INFO, "getInfo");
    requirePointer(systemId, "systemId");
    if (info.formFactor == XR_FORM_FACTOR_HANDHELD_DISPLAY) {
      throw Failure(XR_ERROR_FORM_FACTOR_UNSUPPORTED, "there is only a head-mounted display");
    }
    if (info.formFactor != XR_FORM_FACTOR_HEAD_MOUNTED_DISPLAY) {
      invalid(fmt::format("getInfo->formFactor is {}", static_cast<int>(info.formFactor)));
    }
    owner->system_asked = true;
    *systemId = kSystem;
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrGetSystemProperties(XrInstance instance, XrSystemId systemId,
                                                 XrSystemProperties* properties) {
  return guarded("xrGetSystemProperties", [&](Lock&) {
    withSystem(instance, systemId);
    auto& to = structure(properties, XR_TYPE_SYSTEM_PROPERTIES, "properties");
    to.systemId = kSystem;
    to.vendorId = 0;
    copyText(to.systemName, "SIM2VR simulated headset");
    to.graphicsProperties = {kMaximumImageSize, kMaximumImageSize, kMaximumLayers};
    to.trackingProperties = {XR_TRUE, XR_TRUE};
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrEnumerateEnvironmentBlendModes(
    XrInstance instance, XrSystemId systemId, XrViewConfigurationType viewConfigurationType,
    uint32_t environmentBlendModeCapacityInput, uint32_t* environmentBlendModeCountOutput,
    XrEnvironmentBlendMode* environmentBlendModes) {
  return guarded("xrEnumerateEnvironmentBlendModes", [&](Lock&) {
    withSystem(instance, systemId);
    requireStereo(viewConfigurationType);
    const std::array modes{XR_ENVIRONMENT_BLEND_MODE_OPAQUE};
    return fillItems(std::span<const XrEnvironmentBlendMode>(modes),
                     environmentBlendModeCapacityInput, environmentBlendModeCountOutput,
                     environmentBlendModes, "environmentBlendModes");
  });
}

XrResult XRAPI_CALL calls::xrEnumerateViewConfigurations(
    XrInstance instance, XrSystemId systemId, uint32_t viewConfigurationTypeCapacityInput,
    uint32_t* viewConfigurationTypeCountOutput, XrViewConfigurationType* viewConfigurationTypes) {
  return guarded("xrEnumerateViewConfigurations", [&](Lock&) {
    withSystem(instance, systemId);
    const std::array types{XR_VIEW_CONFIGURATION_TYPE_PRIMARY_STEREO};
    return fillItems(std::span<const XrViewConfigurationType>(types),
                     viewConfigurationTypeCapacityInput, viewConfigurationTypeCountOutput,
                     viewConfigurationTypes, "viewConfigurationTypes");
  });
}

XrResult XRAPI_CALL calls::xrGetViewConfigurationProperties(
    XrInstance instance, XrSystemId systemId, XrViewConfigurationType viewConfigurationType,
    XrViewConfigurationProperties* configurationProperties) {
  return guarded("xrGetViewConfigurationProperties", [&](Lock&) {
    withSystem(instance, systemId);
    auto& to = structure(configurationProperties, XR_TYPE_VIEW_CONFIGURATION_PROPERTIES,
                         "configurationProperties");
    requireStereo(viewConfigurationType);
    to.viewConfigurationType = viewConfigurationType;
    to.fovMutable = XR_FALSE;
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrEnumerateViewConfigurationViews(
    XrInstance instance, XrSystemId systemId, XrViewConfigurationType viewConfigurationType,
    uint32_t viewCapacityInput, uint32_t* viewCountOutput, XrViewConfigurationView* views) {
  return guarded("xrEnumerateViewConfigurationViews", [&](Lock&) {
    const auto owner = withSystem(instance, systemId);
    requireStereo(viewConfigurationType);
    if (!wantsItems(kEyes, viewCapacityInput, viewCountOutput, views, "views")) return XR_SUCCESS;
    requireTypes(views, kEyes, XR_TYPE_VIEW_CONFIGURATION_VIEW, "views");
    for (std::uint32_t i = 0; i < kEyes; ++i) {
      views[i].recommendedImageRectWidth = owner->config.width;
      views[i].recommendedImageRectHeight = owner->config.height;
      views[i].maxImageRectWidth = kMaximumImageSize;
      views[i].maxImageRectHeight = kMaximumImageSize;
      views[i].recommendedSwapchainSampleCount = 1;
      views[i].maxSwapchainSampleCount = kMaximumSamples;
    }
    return XR_SUCCESS;
  });
}

// Instances, their properties and events.

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

const std::vector<Extension>& extensions() {
  static const std::vector<Extension> all = [] {
    std::vector<Extension> list{{"XR_MND_headless", 2},
                                {"XR_KHR_composition_layer_depth", 6},
                                {"XR_KHR_convert_timespec_time", 1},
                                {"XR_KHR_locate_spaces", 1},
                                {"XR_EXT_local_floor", 1},
                                {"XR_EXT_debug_utils", 4}};
    for (const GraphicsMaker& maker : graphicsMakers()) {
      list.push_back({maker.extension, maker.version});
    }
    return list;
  }();
  return all;
}

XrResult XRAPI_CALL calls::xrConvertTimespecTimeToTimeKHR(XrInstance instance,
                                                          const struct timespec* timespecTime,
                                                          XrTime* time) {
  return guarded("xrConvertTimespecTimeToTimeKHR", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    requirePointer(timespecTime, "timespecTime");
    requirePointer(time, "time");
    if (timespecTime->tv_sec < 0 || timespecTime->tv_sec > kSecond_ns ||
        timespecTime->tv_nsec < 0 || timespecTime->tv_nsec >= kSecond_ns) {
      throw Failure(XR_ERROR_TIME_INVALID,
                    fmt::format("timespecTime is {} s and {} ns", timespecTime->tv_sec,
                                timespecTime->tv_nsec));
    }
    const XrTime result =
        timespecTime->tv_sec * kSecond_ns + timespecTime->tv_nsec + clockOffset(*owner);
    requireTime(result, "the time of this moment");
    *time = result;
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrConvertTimeToTimespecTimeKHR(XrInstance instance, XrTime time,
                                                          struct timespec* timespecTime) {
  return guarded("xrConvertTimeToTimespecTimeKHR", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    requirePointer(timespecTime, "timespecTime");
    requireTime(time, "time");
    const std::int64_t monotonic = time - clockOffset(*owner);
    if (monotonic < 0) {
      throw Failure(XR_ERROR_TIME_INVALID, fmt::format("time {} lies before the clock's 0", time));
    }
    *timespecTime = {monotonic / kSecond_ns, monotonic % kSecond_ns};
    return XR_SUCCESS;
  });
}

// XR_EXT_debug_utils: labels go to the harness, as values that a task can read; messengers hear of
// the errors of calls.

XrDebugUtilsMessengerEXT addMessenger(Instance& instance,
                                      const XrDebugUtilsMessengerCreateInfoEXT& info) {
  auto made = std::make_shared<Messenger>();
  made->severities = info.messageSeverities;
  made->types = info.messageTypes;
  made->callback = info.userCallback;
  made->user_data = info.userData;
  return add<XrDebugUtilsMessengerEXT>(made, instance.handle);
}

XrResult XRAPI_CALL calls::xrSetDebugUtilsObjectNameEXT(
    XrInstance instance, const XrDebugUtilsObjectNameInfoEXT* nameInfo) {
  return guarded("xrSetDebugUtilsObjectNameEXT", [&](Lock&) {
    get<Instance>(instance, "instance");
    structure(nameInfo, XR_TYPE_DEBUG_UTILS_OBJECT_NAME_INFO_EXT, "nameInfo");
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrCreateDebugUtilsMessengerEXT(
    XrInstance instance, const XrDebugUtilsMessengerCreateInfoEXT* createInfo,
    XrDebugUtilsMessengerEXT* messenger) {
  return guarded("xrCreateDebugUtilsMessengerEXT", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    const auto& info =
        structure(createInfo, XR_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT, "createInfo");
    requirePointer(messenger, "messenger");
    if (info.userCallback == nullptr) invalid("createInfo->userCallback is null");
    if (info.messageSeverities == 0 || info.messageTypes == 0) {
      invalid("createInfo->messageSeverities or messageTypes is 0");
    }
    *messenger = addMessenger(*owner, info);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrDestroyDebugUtilsMessengerEXT(XrDebugUtilsMessengerEXT messenger) {
  return guarded("xrDestroyDebugUtilsMessengerEXT", [&](Lock&) {
    world().handles.remove(get<Messenger>(messenger, "messenger")->handle);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrSubmitDebugUtilsMessageEXT(
    XrInstance instance, XrDebugUtilsMessageSeverityFlagsEXT messageSeverity,
    XrDebugUtilsMessageTypeFlagsEXT messageTypes,
    const XrDebugUtilsMessengerCallbackDataEXT* callbackData) {
  std::vector<std::shared_ptr<Object>> messengers;
  const XrResult result = guarded("xrSubmitDebugUtilsMessageEXT", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    structure(callbackData, XR_TYPE_DEBUG_UTILS_MESSENGER_CALLBACK_DATA_EXT, "callbackData");
    messengers = world().handles.below(HandleType::messenger, owner->handle);
    return XR_SUCCESS;
  });
  for (const auto& object : messengers) {
    const auto& each = static_cast<const Messenger&>(*object);
    if ((each.severities & messageSeverity) == 0 || (each.types & messageTypes) == 0) continue;
    each.callback(messageSeverity, messageTypes, callbackData, each.user_data);
  }
  return result;
}

XrResult XRAPI_CALL calls::xrSessionBeginDebugUtilsLabelRegionEXT(
    XrSession session, const XrDebugUtilsLabelEXT* labelInfo) {
  return guarded("xrSessionBeginDebugUtilsLabelRegionEXT", [&](Lock&) {
    noteLabel(*liveSession(session), labelInfo);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrSessionEndDebugUtilsLabelRegionEXT(XrSession session) {
  return guarded("xrSessionEndDebugUtilsLabelRegionEXT", [&](Lock&) {
    liveSession(session);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL
calls::xrSessionInsertDebugUtilsLabelEXT(XrSession session, const XrDebugUtilsLabelEXT* labelInfo) {
  return guarded("xrSessionInsertDebugUtilsLabelEXT", [&](Lock&) {
    noteLabel(*liveSession(session), labelInfo);
    return XR_SUCCESS;
  });
}

}  // namespace sim2vr::openxr

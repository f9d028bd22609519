// SPDX-License-Identifier: Apache-2.0
// XR_EXT_debug_utils: labels go to the harness, as values that a task can read; messengers hear of
// the errors of calls.
#include "calls.hpp"
#include "check.hpp"
#include "extensions.hpp"
#include "session_state.hpp"

namespace sim2vr::openxr {
namespace {

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

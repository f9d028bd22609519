// An API layer that records what a person does in any OpenXR program, over any runtime. It does
// nothing unless SIM2VR_OPENXR_RECORD names a file.
#include "layer.hpp"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

namespace sim2vr::openxr::layer {
namespace {

constexpr const char* kVariable = "SIM2VR_OPENXR_RECORD";
constexpr XrPosef kIdentity{{0.0F, 0.0F, 0.0F, 1.0F}, {0.0F, 0.0F, 0.0F}};

struct Vibration {
  xr::Hand hand;
  XrHapticVibration what;
};

/// A frame that ended. What the program reads until it waits for the next frame, it reads of this
/// one: only then its inputs are known.
struct EndedFrame {
  XrTime time = 0;  // 0: none
  XrPosef head = kIdentity;
  std::array<xr::ControllerState, 2> hands;
  std::vector<Vibration> vibrations;  // since the frame before ended
};

/// One instance and one session at a time, as programs have.
struct Recorder {
  std::mutex mutex;
  Next next;
  std::unique_ptr<OwnActions> actions;
  std::unique_ptr<Recording> recording;
  std::string application;
  XrSession session = XR_NULL_HANDLE;
  XrSpace view = XR_NULL_HANDLE;
  XrSpace stage = XR_NULL_HANDLE;
  EndedFrame ended;
  std::vector<Vibration> vibrations;  // since that frame ended
};
Recorder& recorder() {
  static auto* instance = new Recorder;
  return *instance;
}

std::array<xr::ControllerState, 2> readHands(const Recorder& self, XrTime time) {
  std::array<xr::ControllerState, 2> hands;
  if (!self.actions->attached()) return hands;
  for (const xr::Hand hand : xr::kHands) {
    hands[static_cast<std::size_t>(hand)] =
        self.actions->read(self.next, self.session, hand, self.stage, time);
  }
  return hands;
}

/// Writes the frame that ended, with the inputs of the latest xrSyncActions.
void writeEnded(Recorder& self) {
  const EndedFrame ended = std::exchange(self.ended, {});
  if (!self.recording || ended.time == 0) return;
  auto hands = readHands(self, ended.time);
  for (std::size_t i = 0; i < hands.size(); ++i) {
    if (!ended.hands[i].active) continue;
    if (!hands[i].active) hands[i] = ended.hands[i];
    hands[i].grip = ended.hands[i].grip;
    hands[i].aim = ended.hands[i].aim;
  }
  self.recording->frame(ended.time, ended.head, hands);
  for (const Vibration& each : ended.vibrations) {
    self.recording->haptic(each.hand == xr::Hand::left ? "left" : "right", each.what);
  }
}

/// The hand that a path begins with; nothing: neither.
std::optional<xr::Hand> handOf(std::string_view path) {
  if (path.starts_with("/user/hand/left")) return xr::Hand::left;
  if (path.starts_with("/user/hand/right")) return xr::Hand::right;
  return std::nullopt;
}

/// The hands that an action with or without subaction path shakes.
std::set<xr::Hand> shaken(const Recorder& self, const XrHapticActionInfo& info) {
  std::vector<XrPath> paths{info.subactionPath};
  if (info.subactionPath == XR_NULL_PATH) {
    const XrBoundSourcesForActionEnumerateInfo wanted{
        XR_TYPE_BOUND_SOURCES_FOR_ACTION_ENUMERATE_INFO, nullptr, info.action};
    const auto sources = SIM2VR_NEXT(self.next, xrEnumerateBoundSourcesForAction);
    std::uint32_t count = 0;
    sources(self.session, &wanted, 0, &count, nullptr);
    paths.resize(count);
    if (sources(self.session, &wanted, count, &count, paths.data()) != XR_SUCCESS) paths.clear();
  }
  std::set<xr::Hand> hands;
  for (const XrPath path : paths) {
    char text[XR_MAX_PATH_LENGTH]{};
    std::uint32_t length = 0;
    SIM2VR_NEXT(self.next, xrPathToString)
    (self.next.instance(), path, XR_MAX_PATH_LENGTH, &length, text);
    if (const auto hand = handOf(text)) hands.insert(*hand);
  }
  return hands;
}

/// STAGE where the runtime has it, else LOCAL.
void makeSpaces(Recorder& self) {
  const auto make = [&](XrReferenceSpaceType type) {
    const XrReferenceSpaceCreateInfo info{XR_TYPE_REFERENCE_SPACE_CREATE_INFO, nullptr, type,
                                          kIdentity};
    XrSpace space = XR_NULL_HANDLE;
    SIM2VR_NEXT(self.next, xrCreateReferenceSpace)(self.session, &info, &space);
    return space;
  };
  self.view = make(XR_REFERENCE_SPACE_TYPE_VIEW);
  self.stage = make(XR_REFERENCE_SPACE_TYPE_STAGE);
  if (self.stage == XR_NULL_HANDLE) self.stage = make(XR_REFERENCE_SPACE_TYPE_LOCAL);
}

XrResult XRAPI_CALL createSession(XrInstance instance, const XrSessionCreateInfo* info,
                                  XrSession* session) {
  Recorder& self = recorder();
  const XrResult result = SIM2VR_NEXT(self.next, xrCreateSession)(instance, info, session);
  if (result != XR_SUCCESS) return result;
  const std::lock_guard lock(self.mutex);
  self.session = *session;
  makeSpaces(self);
  self.recording = std::make_unique<Recording>(std::getenv(kVariable), self.application);
  return result;
}

XrResult XRAPI_CALL destroySession(XrSession session) {
  Recorder& self = recorder();
  {
    const std::lock_guard lock(self.mutex);
    writeEnded(self);
    self.vibrations.clear();
    self.recording.reset();
    self.session = XR_NULL_HANDLE;
    self.actions = std::make_unique<OwnActions>();
  }
  return SIM2VR_NEXT(self.next, xrDestroySession)(session);
}

XrResult XRAPI_CALL suggest(XrInstance instance,
                            const XrInteractionProfileSuggestedBinding* suggested) {
  Recorder& self = recorder();
  const auto next = SIM2VR_NEXT(self.next, xrSuggestInteractionProfileBindings);
  const std::lock_guard lock(self.mutex);
  if (suggested != nullptr && suggested->suggestedBindings != nullptr &&
      self.actions->create(self.next)) {
    const auto bindings = self.actions->withOurs(self.next, *suggested);
    XrInteractionProfileSuggestedBinding all = *suggested;
    all.countSuggestedBindings = static_cast<std::uint32_t>(bindings.size());
    all.suggestedBindings = bindings.data();
    if (next(instance, &all) == XR_SUCCESS) return XR_SUCCESS;
  }
  return next(instance, suggested);
}

XrResult XRAPI_CALL attach(XrSession session, const XrSessionActionSetsAttachInfo* info) {
  Recorder& self = recorder();
  const auto next = SIM2VR_NEXT(self.next, xrAttachSessionActionSets);
  const std::lock_guard lock(self.mutex);
  if (info == nullptr || info->actionSets == nullptr || !self.actions->create(self.next)) {
    return next(session, info);
  }
  std::vector<XrActionSet> sets(info->actionSets, info->actionSets + info->countActionSets);
  sets.push_back(self.actions->set());
  XrSessionActionSetsAttachInfo all = *info;
  all.countActionSets = static_cast<std::uint32_t>(sets.size());
  all.actionSets = sets.data();
  const XrResult result = next(session, &all);
  if (result == XR_SUCCESS) self.actions->attach(self.next, session);
  return result;
}

XrResult XRAPI_CALL sync(XrSession session, const XrActionsSyncInfo* info) {
  Recorder& self = recorder();
  const auto next = SIM2VR_NEXT(self.next, xrSyncActions);
  const std::lock_guard lock(self.mutex);
  if (info == nullptr || !self.actions->attached()) return next(session, info);
  std::vector<XrActiveActionSet> sets;
  if (info->activeActionSets != nullptr) {
    sets.assign(info->activeActionSets, info->activeActionSets + info->countActiveActionSets);
  }
  sets.push_back({self.actions->set(), XR_NULL_PATH});
  XrActionsSyncInfo all = *info;
  all.countActiveActionSets = static_cast<std::uint32_t>(sets.size());
  all.activeActionSets = sets.data();
  return next(session, &all);
}

XrResult XRAPI_CALL endFrame(XrSession session, const XrFrameEndInfo* info) {
  Recorder& self = recorder();
  if (info != nullptr && info->displayTime > 0) {
    const std::lock_guard lock(self.mutex);
    XrSpaceLocation head{XR_TYPE_SPACE_LOCATION, nullptr, 0, kIdentity};
    if (self.recording && SIM2VR_NEXT(self.next, xrLocateSpace)(
                              self.view, self.stage, info->displayTime, &head) == XR_SUCCESS) {
      writeEnded(self);  // of a program that waits for a frame before it ends the last
      self.ended = {info->displayTime, head.pose, readHands(self, info->displayTime),
                    std::exchange(self.vibrations, {})};
    }
  }
  return SIM2VR_NEXT(self.next, xrEndFrame)(session, info);
}

XrResult XRAPI_CALL vibrate(XrSession session, const XrHapticActionInfo* info,
                            const XrHapticBaseHeader* feedback) {
  Recorder& self = recorder();
  const XrResult result = SIM2VR_NEXT(self.next, xrApplyHapticFeedback)(session, info, feedback);
  if (result != XR_SUCCESS || feedback->type != XR_TYPE_HAPTIC_VIBRATION) return result;
  const std::lock_guard lock(self.mutex);
  if (!self.recording) return result;
  const auto& vibration = *reinterpret_cast<const XrHapticVibration*>(feedback);
  for (const xr::Hand hand : shaken(self, *info)) self.vibrations.push_back({hand, vibration});
  return result;
}

XrResult XRAPI_CALL waitFrame(XrSession session, const XrFrameWaitInfo* info, XrFrameState* state) {
  Recorder& self = recorder();
  {
    const std::lock_guard lock(self.mutex);
    writeEnded(self);
  }
  return SIM2VR_NEXT(self.next, xrWaitFrame)(session, info, state);
}

XrResult XRAPI_CALL getFunction(XrInstance instance, const char* name,
                                PFN_xrVoidFunction* function) {
  struct Ours {
    std::string_view name;
    PFN_xrVoidFunction function;
  };
  static const Ours kOurs[]{
      {"xrGetInstanceProcAddr", reinterpret_cast<PFN_xrVoidFunction>(&getFunction)},
      {"xrCreateSession", reinterpret_cast<PFN_xrVoidFunction>(&createSession)},
      {"xrDestroySession", reinterpret_cast<PFN_xrVoidFunction>(&destroySession)},
      {"xrSuggestInteractionProfileBindings", reinterpret_cast<PFN_xrVoidFunction>(&suggest)},
      {"xrAttachSessionActionSets", reinterpret_cast<PFN_xrVoidFunction>(&attach)},
      {"xrSyncActions", reinterpret_cast<PFN_xrVoidFunction>(&sync)},
      {"xrWaitFrame", reinterpret_cast<PFN_xrVoidFunction>(&waitFrame)},
      {"xrEndFrame", reinterpret_cast<PFN_xrVoidFunction>(&endFrame)},
      {"xrApplyHapticFeedback", reinterpret_cast<PFN_xrVoidFunction>(&vibrate)}};
  if (std::getenv(kVariable) != nullptr && name != nullptr) {
    for (const Ours& each : kOurs) {
      if (each.name != name) continue;
      *function = each.function;
      return XR_SUCCESS;
    }
  }
  return recorder().next.get()(instance, name, function);
}

// openxr/loader_interfaces.h, which distributions do not ship.
struct NextInfo {
  std::uint32_t type, version;
  std::size_t size;
  char layer_name[XR_MAX_API_LAYER_NAME_SIZE];
  PFN_xrGetInstanceProcAddr get;
  XrResult(XRAPI_PTR* create)(const XrInstanceCreateInfo*, const struct CreateInfo*, XrInstance*);
  NextInfo* next;
};
struct CreateInfo {
  std::uint32_t type, version;
  std::size_t size;
  void* loader_instance;
  char settings[512];
  NextInfo* next;
};

XrResult XRAPI_CALL createInstance(const XrInstanceCreateInfo* info, const CreateInfo* layer_info,
                                   XrInstance* instance) {
  if (layer_info == nullptr || layer_info->next == nullptr) return XR_ERROR_INITIALIZATION_FAILED;
  CreateInfo below = *layer_info;
  below.next = layer_info->next->next;
  const XrResult result = layer_info->next->create(info, &below, instance);
  if (result != XR_SUCCESS) return result;
  Recorder& self = recorder();
  const std::lock_guard lock(self.mutex);
  self.next = Next(*instance, layer_info->next->get);
  self.actions = std::make_unique<OwnActions>();
  self.application = info->applicationInfo.applicationName;
  return result;
}

}  // namespace
}  // namespace sim2vr::openxr::layer

namespace {

struct LoaderInfo {
  std::uint32_t type, version;
  std::size_t size;
  std::uint32_t min_interface, max_interface;
  XrVersion min_api, max_api;
};
struct LayerRequest {
  std::uint32_t type, version;
  std::size_t size;
  std::uint32_t interface;
  XrVersion api;
  PFN_xrGetInstanceProcAddr get;
  decltype(&sim2vr::openxr::layer::createInstance) create;
};

}  // namespace

extern "C" __attribute__((visibility("default"))) XrResult xrNegotiateLoaderApiLayerInterface(
    const LoaderInfo* loader, const char* name, LayerRequest* request);

XrResult xrNegotiateLoaderApiLayerInterface(const LoaderInfo* loader, const char*,
                                            LayerRequest* request) {
  if (loader == nullptr || request == nullptr || loader->type != 1 || request->type != 2 ||
      request->size != sizeof *request || loader->min_interface > 1 || loader->max_interface < 1) {
    return XR_ERROR_INITIALIZATION_FAILED;
  }
  request->interface = 1;
  request->api = loader->max_api;
  request->get = &sim2vr::openxr::layer::getFunction;
  request->create = &sim2vr::openxr::layer::createInstance;
  return XR_SUCCESS;
}

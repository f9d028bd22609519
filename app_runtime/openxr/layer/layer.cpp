// SPDX-License-Identifier: Apache-2.0
// An API layer that records what a person does in any OpenXR program, over any runtime. It does
// nothing unless SIM2VR_OPENXR_RECORD names a file.
#include "layer.hpp"

#include "sim2vr/xr/profiles.hpp"

#include <cxxabi.h>
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <memory>
#include <new>
#include <optional>
#include <utility>

namespace sim2vr::openxr::layer {
namespace {

constexpr const char* kVariable = "SIM2VR_OPENXR_RECORD";

void sayLost(const char* cause) {
  static std::atomic<bool> said{false};
  if (!said.exchange(true)) say("a part of the recording is lost: ", cause);
}

/// What `work` returns, or `fallback` where it throws: the program's call goes on as without us.
template <class T, class Work>
T guardedLayer(T fallback, Work&& work) {
  try {
    return work();
  } catch (const abi::__forced_unwind&) {
    throw;  // the program cancels this thread
  } catch (const std::exception& error) {
    sayLost(error.what());
  } catch (...) {
    sayLost("unknown");
  }
  return fallback;
}

/// An instance of the program. One of its sessions at a time is recorded.
struct Recorder {
  /// Found by; none: free, or on its way out.
  std::atomic<XrInstance> instance{XR_NULL_HANDLE};
  bool taken = false;  // under the mutex of all
  /// Of a program that does not want a recording, or that has none of the functions we need, we
  /// intercept nothing.
  std::atomic<bool> records{false};
  Next next;
  int process = 0;
  std::string file;
  std::string application;
  std::array<std::atomic<XrSession>, 8> sessions{};
  /// Frames whose recording failed.
  std::atomic<std::uint64_t> missed{0};

  std::mutex mutex;  // of what follows
  OwnActions actions;
  std::unique_ptr<Recording> recording;
  XrSession session = XR_NULL_HANDLE;
  XrSpace view = XR_NULL_HANDLE;
  XrSpace stage = XR_NULL_HANDLE;
  EndedFrame ended;
  Vibrations vibrations;  // since that frame ended
  Lost lost;              // since that frame ended

  /// A process that was forked off the program has no writer thread, and locks that nobody frees.
  bool ofThisProcess() const { return process == ::getpid(); }
};

/// Never destroyed, as programs call from threads that outlive main(), and never allocated.
struct All {
  std::mutex mutex;
  std::array<Recorder, 16> recorders;
  /// For what comes with an instance that found no room.
  std::atomic<PFN_xrGetInstanceProcAddr> latest_get{nullptr};
};
All& all() {
  alignas(All) static std::byte memory[sizeof(All)];
  static All* const made = new (memory) All;
  return *made;
}

Recorder* ofInstance(XrInstance instance) {
  if (instance == XR_NULL_HANDLE) return nullptr;
  for (Recorder& each : all().recorders) {
    if (each.instance == instance) return &each;
  }
  return nullptr;
}

/// The instance of a session; of an unknown one any that we intercept, which says what is wrong.
Recorder* ofSession(XrSession session) {
  Recorder* any = nullptr;
  for (Recorder& each : all().recorders) {
    if (each.instance == XR_NULL_HANDLE || !each.records) continue;
    for (const auto& own : each.sessions) {
      if (session != XR_NULL_HANDLE && own == session) return &each;
    }
    if (any == nullptr) any = &each;
  }
  return any;
}

std::array<xr::ControllerState, 2> readHands(const Recorder& self, XrTime time) {
  std::array<xr::ControllerState, 2> hands;
  if (!self.actions.attached()) return hands;
  for (const xr::Hand hand : xr::kHands) {
    hands[static_cast<std::size_t>(hand)] =
        self.actions.read(self.next, self.session, hand, self.stage, time);
  }
  return hands;
}

/// Records the frame that ended, with the inputs of the latest xrSyncActions.
void finishEnded(Recorder& self) {
  if (!self.recording || self.ended.time == 0) return;
  auto hands = readHands(self, self.ended.time);
  for (std::size_t i = 0; i < hands.size(); ++i) {
    const xr::ControllerState& before = self.ended.hands[i];
    if (!before.active) continue;
    if (!hands[i].active) hands[i] = before;
    hands[i].grip = before.grip;
    hands[i].aim = before.aim;
  }
  self.ended.hands = hands;
  self.recording->add(self.ended);
  self.ended.time = 0;
}

/// Whether an action with or without subaction path shakes each hand.
std::array<bool, 2> shaken(const Recorder& self, const XrHapticActionInfo& info) {
  std::array<XrPath, 32> paths{info.subactionPath};
  std::uint32_t count = 1;
  if (info.subactionPath == XR_NULL_PATH) {
    const XrBoundSourcesForActionEnumerateInfo wanted{
        XR_TYPE_BOUND_SOURCES_FOR_ACTION_ENUMERATE_INFO, nullptr, info.action};
    count = 0;
    if (self.next.xrEnumerateBoundSourcesForAction(self.session, &wanted,
                                                   static_cast<std::uint32_t>(paths.size()), &count,
                                                   paths.data()) != XR_SUCCESS) {
      return {};
    }
  }
  std::array<bool, 2> hands{};
  for (std::uint32_t i = 0; i < count && i < paths.size(); ++i) {
    char text[XR_MAX_PATH_LENGTH]{};
    std::uint32_t length = 0;
    self.next.xrPathToString(self.next.instance, paths[i], XR_MAX_PATH_LENGTH, &length, text);
    if (const auto hand = xr::handOf(text)) hands[static_cast<std::size_t>(*hand)] = true;
  }
  return hands;
}

/// STAGE where the runtime has it, else LOCAL.
void makeSpaces(Recorder& self) {
  const auto make = [&](XrReferenceSpaceType type) {
    const XrReferenceSpaceCreateInfo info{XR_TYPE_REFERENCE_SPACE_CREATE_INFO, nullptr, type,
                                          xr::kIdentityPose};
    XrSpace space = XR_NULL_HANDLE;
    return self.next.xrCreateReferenceSpace(self.session, &info, &space) == XR_SUCCESS
               ? space
               : XR_NULL_HANDLE;
  };
  self.view = make(XR_REFERENCE_SPACE_TYPE_VIEW);
  self.stage = make(XR_REFERENCE_SPACE_TYPE_STAGE);
  if (self.stage == XR_NULL_HANDLE) self.stage = make(XR_REFERENCE_SPACE_TYPE_LOCAL);
}

void begin(Recorder& self, XrSession session) {
  const std::lock_guard lock(self.mutex);
  if (self.session != XR_NULL_HANDLE) return;
  self.session = session;
  makeSpaces(self);
  std::string name = self.file;  // with %p for the process's number
  if (const std::size_t at = name.find("%p"); at != std::string::npos) {
    name.replace(at, 2, std::to_string(::getpid()));
  }
  const int file = ::open(name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (file < 0) {
    say((name + ": " + std::strerror(errno) + "; nothing is recorded").c_str());
    return;
  }
  try {
    self.recording = std::make_unique<Recording>(file, self.application);
  } catch (...) {
    ::close(file);
    throw;
  }
}

/// `reads`: the runtime can still be asked.
void end(Recorder& self, bool reads) {
  if (reads) {
    finishEnded(self);
  } else if (self.recording && self.ended.time != 0) {
    self.recording->add(self.ended);
  }
  if (self.recording) {
    self.lost.frames += self.missed.exchange(0);
    self.lost.vibrations += self.vibrations.count;
    self.recording->lose(self.lost);
  }
  self.recording.reset();
  self.ended.time = 0;
  self.vibrations.count = 0;
  self.lost = {};
  self.session = XR_NULL_HANDLE;
  self.actions.detach();
}

/// A program that leaves without xrDestroySession keeps what it recorded.
__attribute__((destructor)) void atExit() {
  guardedLayer(false, [] {
    for (Recorder& each : all().recorders) {
      if (!each.ofThisProcess()) continue;
      // Held: by a thread that exit() found in a call, or by the caller of exit() itself.
      const std::unique_lock lock(each.mutex, std::try_to_lock);
      if (lock.owns_lock()) end(each, false);
    }
    return true;
  });
}

XrResult XRAPI_CALL createSession(XrInstance instance, const XrSessionCreateInfo* info,
                                  XrSession* session) {
  Recorder* self = ofInstance(instance);
  if (self == nullptr) return XR_ERROR_HANDLE_INVALID;
  const XrResult result = self->next.xrCreateSession(instance, info, session);
  if (XR_FAILED(result)) return result;
  for (auto& own : self->sessions) {
    XrSession none = XR_NULL_HANDLE;
    if (own.compare_exchange_strong(none, *session)) break;
  }
  guardedLayer(false, [&] {
    if (self->ofThisProcess()) begin(*self, *session);
    return true;
  });
  return result;
}

XrResult XRAPI_CALL destroySession(XrSession session) {
  Recorder* self = ofSession(session);
  if (self == nullptr) return XR_ERROR_HANDLE_INVALID;
  guardedLayer(false, [&] {
    if (!self->ofThisProcess()) return false;
    const std::lock_guard lock(self->mutex);
    if (self->session == session) end(*self, true);
    return true;
  });
  const XrResult result = self->next.xrDestroySession(session);
  if (XR_FAILED(result)) return result;
  for (auto& own : self->sessions) {
    XrSession gone = session;
    own.compare_exchange_strong(gone, XR_NULL_HANDLE);
  }
  return result;
}

XrResult XRAPI_CALL destroyInstance(XrInstance instance) {
  Recorder* self = ofInstance(instance);
  if (self == nullptr) return XR_ERROR_HANDLE_INVALID;
  guardedLayer(false, [&] {
    if (!self->ofThisProcess()) return false;
    const std::lock_guard lock(self->mutex);
    end(*self, true);
    return true;
  });
  // Before it is gone: the runtime may give the same handle to the next one at once.
  self->instance = XR_NULL_HANDLE;
  const XrResult result = self->next.xrDestroyInstance(instance);
  if (XR_FAILED(result)) {
    self->instance = instance;
    return result;
  }
  guardedLayer(false, [&] {
    const std::lock_guard lock(all().mutex);
    self->taken = false;
    return true;
  });
  return result;
}

XrResult XRAPI_CALL suggest(XrInstance instance,
                            const XrInteractionProfileSuggestedBinding* suggested) {
  Recorder* self = ofInstance(instance);
  if (self == nullptr) return XR_ERROR_HANDLE_INVALID;
  const bool taken = guardedLayer(false, [&] {
    if (!self->ofThisProcess() || suggested == nullptr || suggested->suggestedBindings == nullptr) {
      return false;
    }
    std::vector<XrActionSuggestedBinding> bindings;
    {
      const std::lock_guard lock(self->mutex);
      if (!self->actions.create(self->next)) return false;
      bindings = self->actions.withOurs(self->next, *suggested);
    }
    XrInteractionProfileSuggestedBinding with_ours = *suggested;
    with_ours.countSuggestedBindings = static_cast<std::uint32_t>(bindings.size());
    with_ours.suggestedBindings = bindings.data();
    return self->next.xrSuggestInteractionProfileBindings(instance, &with_ours) == XR_SUCCESS;
  });
  return taken ? XR_SUCCESS : self->next.xrSuggestInteractionProfileBindings(instance, suggested);
}

XrResult XRAPI_CALL attach(XrSession session, const XrSessionActionSetsAttachInfo* info) {
  Recorder* self = ofSession(session);
  if (self == nullptr) return XR_ERROR_HANDLE_INVALID;
  const bool taken = guardedLayer(false, [&] {
    if (!self->ofThisProcess() || info == nullptr || info->actionSets == nullptr) return false;
    std::vector<XrActionSet> sets(info->actionSets, info->actionSets + info->countActionSets);
    const std::lock_guard lock(self->mutex);
    if (self->session != session || !self->actions.create(self->next)) return false;
    sets.push_back(self->actions.set());
    XrSessionActionSetsAttachInfo with_ours = *info;
    with_ours.countActionSets = static_cast<std::uint32_t>(sets.size());
    with_ours.actionSets = sets.data();
    if (self->next.xrAttachSessionActionSets(session, &with_ours) != XR_SUCCESS) return false;
    self->actions.attach(self->next, session);
    return true;
  });
  return taken ? XR_SUCCESS : self->next.xrAttachSessionActionSets(session, info);
}

XrResult XRAPI_CALL sync(XrSession session, const XrActionsSyncInfo* info) {
  Recorder* self = ofSession(session);
  if (self == nullptr) return XR_ERROR_HANDLE_INVALID;
  std::array<XrActiveActionSet, 128> sets;
  XrActionsSyncInfo with_ours{};
  const bool added = guardedLayer(false, [&] {
    if (!self->ofThisProcess() || info == nullptr) return false;
    const std::uint32_t count = info->activeActionSets == nullptr ? 0 : info->countActiveActionSets;
    if (count >= sets.size()) return false;
    std::copy_n(info->activeActionSets, count, sets.begin());
    const std::lock_guard lock(self->mutex);
    if (self->session != session || !self->actions.attached()) return false;
    sets[count] = {self->actions.set(), XR_NULL_PATH};
    with_ours = *info;
    with_ours.countActiveActionSets = count + 1;
    with_ours.activeActionSets = sets.data();
    return true;
  });
  if (added) {
    const XrResult result = self->next.xrSyncActions(session, &with_ours);
    if (XR_SUCCEEDED(result)) return result;
  }
  return self->next.xrSyncActions(session, info);
}

void noteEnded(Recorder& self, XrSession session, XrTime time) {
  const std::lock_guard lock(self.mutex);
  if (!self.recording || self.session != session) return;
  constexpr XrSpaceLocationFlags kValid =
      XR_SPACE_LOCATION_ORIENTATION_VALID_BIT | XR_SPACE_LOCATION_POSITION_VALID_BIT;
  XrSpaceLocation head{XR_TYPE_SPACE_LOCATION, nullptr, 0, xr::kIdentityPose};
  if (self.next.xrLocateSpace(self.view, self.stage, time, &head) != XR_SUCCESS ||
      (head.locationFlags & kValid) != kValid) {
    return;
  }
  finishEnded(self);  // of a program that waits for a frame before it ends the last
  self.lost.frames += self.missed.exchange(0);
  self.ended = {time, head.pose, readHands(self, time), self.vibrations, self.lost};
  self.vibrations.count = 0;
  self.lost = {};
}

XrResult XRAPI_CALL endFrame(XrSession session, const XrFrameEndInfo* info) {
  Recorder* self = ofSession(session);
  if (self == nullptr) return XR_ERROR_HANDLE_INVALID;
  const bool noted = guardedLayer(false, [&] {
    if (info != nullptr && info->displayTime > 0 && self->ofThisProcess()) {
      noteEnded(*self, session, info->displayTime);
    }
    return true;
  });
  if (!noted) ++self->missed;
  return self->next.xrEndFrame(session, info);
}

void noteVibration(Recorder& self, XrSession session, const XrHapticActionInfo& info,
                   const XrHapticVibration& vibration) {
  const std::lock_guard lock(self.mutex);
  if (!self.recording || self.session != session) return;
  const auto hands = shaken(self, info);
  for (const xr::Hand hand : xr::kHands) {
    if (!hands[static_cast<std::size_t>(hand)]) continue;
    if (self.vibrations.count == self.vibrations.each.size()) {
      ++self.lost.vibrations;
      continue;
    }
    self.vibrations.each[self.vibrations.count++] = {hand, vibration.amplitude, vibration.frequency,
                                                     vibration.duration};
  }
}

XrResult XRAPI_CALL vibrate(XrSession session, const XrHapticActionInfo* info,
                            const XrHapticBaseHeader* feedback) {
  Recorder* self = ofSession(session);
  if (self == nullptr) return XR_ERROR_HANDLE_INVALID;
  const XrResult result = self->next.xrApplyHapticFeedback(session, info, feedback);
  if (result != XR_SUCCESS || info == nullptr || feedback == nullptr ||
      feedback->type != XR_TYPE_HAPTIC_VIBRATION || !self->ofThisProcess()) {
    return result;
  }
  guardedLayer(false, [&] {
    noteVibration(*self, session, *info, *reinterpret_cast<const XrHapticVibration*>(feedback));
    return true;
  });
  return result;
}

XrResult XRAPI_CALL waitFrame(XrSession session, const XrFrameWaitInfo* info, XrFrameState* state) {
  Recorder* self = ofSession(session);
  if (self == nullptr) return XR_ERROR_HANDLE_INVALID;
  guardedLayer(false, [&] {
    if (!self->ofThisProcess()) return false;
    const std::lock_guard lock(self->mutex);
    if (self->session == session) finishEnded(*self);
    return true;
  });
  return self->next.xrWaitFrame(session, info, state);
}

XrResult XRAPI_CALL getFunction(XrInstance instance, const char* name,
                                PFN_xrVoidFunction* function) {
  struct Ours {
    std::string_view name;
    PFN_xrVoidFunction function;
  };
  static const Ours kOurs[]{
      {"xrGetInstanceProcAddr", reinterpret_cast<PFN_xrVoidFunction>(&getFunction)},
      {"xrDestroyInstance", reinterpret_cast<PFN_xrVoidFunction>(&destroyInstance)},
      {"xrCreateSession", reinterpret_cast<PFN_xrVoidFunction>(&createSession)},
      {"xrDestroySession", reinterpret_cast<PFN_xrVoidFunction>(&destroySession)},
      {"xrSuggestInteractionProfileBindings", reinterpret_cast<PFN_xrVoidFunction>(&suggest)},
      {"xrAttachSessionActionSets", reinterpret_cast<PFN_xrVoidFunction>(&attach)},
      {"xrSyncActions", reinterpret_cast<PFN_xrVoidFunction>(&sync)},
      {"xrWaitFrame", reinterpret_cast<PFN_xrVoidFunction>(&waitFrame)},
      {"xrEndFrame", reinterpret_cast<PFN_xrVoidFunction>(&endFrame)},
      {"xrApplyHapticFeedback", reinterpret_cast<PFN_xrVoidFunction>(&vibrate)}};
  const Recorder* self = ofInstance(instance);
  if (self != nullptr && name != nullptr && function != nullptr) {
    for (const Ours& each : kOurs) {
      if (each.name != name) continue;
      // Of an instance that is not recorded we want to know only when it goes.
      const bool goes = each.function == reinterpret_cast<PFN_xrVoidFunction>(&destroyInstance) &&
                        self->next.xrDestroyInstance != nullptr;
      if (!self->records && !goes) break;
      *function = each.function;
      return XR_SUCCESS;
    }
  }
  const PFN_xrGetInstanceProcAddr get = self != nullptr ? self->next.get : all().latest_get.load();
  if (get != nullptr) return get(instance, name, function);
  if (function != nullptr) *function = nullptr;
  return XR_ERROR_HANDLE_INVALID;
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

/// An instance is found from here on; what can fail comes after that.
void enroll(XrInstance instance, PFN_xrGetInstanceProcAddr get, const XrInstanceCreateInfo& info) {
  const char* file = std::getenv(kVariable);
  Recorder* self = nullptr;
  {
    const std::lock_guard lock(all().mutex);
    for (Recorder& each : all().recorders) {
      if (each.taken) continue;
      self = &each;
      break;
    }
    if (self == nullptr) {
      if (file != nullptr) say("too many instances; nothing is recorded of this one");
      return;
    }
    self->taken = true;
  }
  self->records = false;
  self->next = {};
  self->next.instance = instance;
  self->next.get = get;
  self->process = ::getpid();
  self->actions = {};
  for (auto& own : self->sessions) own = XR_NULL_HANDLE;
  self->missed = 0;
  const bool complete = self->next.fill();
  self->instance = instance;
  if (file == nullptr) return;
  self->file = file;
  self->application = info.applicationInfo.applicationName;
  if (!complete) {
    say("the runtime lacks a function of OpenXR 1.0; nothing is recorded");
    return;
  }
  self->records = true;
}

XrResult XRAPI_CALL createInstance(const XrInstanceCreateInfo* info, const CreateInfo* layer_info,
                                   XrInstance* instance) {
  if (layer_info == nullptr || layer_info->next == nullptr || layer_info->next->get == nullptr ||
      layer_info->next->create == nullptr) {
    return XR_ERROR_INITIALIZATION_FAILED;
  }
  CreateInfo below = *layer_info;
  below.next = layer_info->next->next;
  const XrResult result = layer_info->next->create(info, &below, instance);
  if (XR_FAILED(result)) return result;
  all().latest_get = layer_info->next->get;
  guardedLayer(false, [&] {
    enroll(*instance, layer_info->next->get, *info);
    return true;
  });
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

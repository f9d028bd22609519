// SPDX-License-Identifier: Apache-2.0
#include "session.hpp"

#include <cstring>

#include "api.hpp"
#include "calls.hpp"
#include "check.hpp"
#include "frames.hpp"
#include "instance.hpp"
#include "sim2vr/xr/session_states.hpp"

namespace sim2vr::openxr {
namespace {

constexpr std::size_t kMaximumEvents = 1000;

bool enabledGraphics(const Instance& instance) {
  for (const GraphicsMaker& maker : graphicsMakers()) {
    if (instance.enabled(maker.extension)) return true;
  }
  return false;
}

/// The program's binding picks the graphics; of two ways with the same binding (the two of Vulkan)
/// the one whose requirements were asked for.
void makeGraphics(const Instance& instance, const XrSessionCreateInfo& info, Session& session) {
  std::string_view missing;
  for (const GraphicsMaker& maker : graphicsMakers()) {
    if (!instance.enabled(maker.extension)) continue;
    const auto* binding = chained<XrBaseInStructure>(info.next, maker.binding);
    if (binding == nullptr) continue;
    if (!maker.requirements.empty() && !instance.requirements_asked.contains(maker.requirements)) {
      missing = maker.requirements;
      continue;
    }
    session.graphics = maker.create(*binding);
    session.graphics_name = session.graphics->name();
    return;
  }
  if (!missing.empty()) {
    throw Failure(XR_ERROR_GRAPHICS_REQUIREMENTS_CALL_MISSING,
                  fmt::format("{} has to be called before", missing));
  }
  if (instance.enabled("XR_MND_headless")) return;
  throw Failure(XR_ERROR_GRAPHICS_DEVICE_INVALID,
                enabledGraphics(instance)
                    ? "createInfo->next holds no binding of an enabled graphics extension"
                    : "no graphics extension is enabled");
}

void requireOnlySession(const Instance& instance) {
  if (!world().handles.below(HandleType::session, instance.handle).empty()) {
    throw Failure(XR_ERROR_LIMIT_REACHED, "the program has a session already");
  }
}

}  // namespace

void queueEvent(Instance& instance, const void* event, std::size_t bytes) {
  XrEventDataBuffer buffer{};
  std::memcpy(&buffer, event, bytes);
  if (instance.events.size() >= kMaximumEvents) {
    XrEventDataEventsLost lost{XR_TYPE_EVENT_DATA_EVENTS_LOST, nullptr, 1};
    const XrEventDataBuffer& oldest = instance.events.front();
    if (oldest.type == XR_TYPE_EVENT_DATA_EVENTS_LOST) {
      std::memcpy(&lost, &oldest, sizeof lost);
      ++lost.lostEventCount;
      instance.events.pop_front();
    }
    instance.events.pop_front();
    XrEventDataBuffer first{};
    std::memcpy(&first, &lost, sizeof lost);
    instance.events.push_front(first);
  }
  instance.events.push_back(buffer);
}

void enterState(Session& session, XrSessionState state) {
  session.state = state;
  const XrEventDataSessionStateChanged event{XR_TYPE_EVENT_DATA_SESSION_STATE_CHANGED, nullptr,
                                             reinterpret_cast<XrSession>(session.handle), state,
                                             session.now()};
  queueEvent(*session.instance, event);
  if (Harness* harness = session.instance->harness.get()) {
    harness->note({.kind = "state", .text = xr::stateName(state), .time_ns = session.now()});
  }
}

void start(Session& session) {
  xr::toReady([&](XrSessionState state) { enterState(session, state); });
}

void show(Session& session) {
  if (session.state != XR_SESSION_STATE_READY || session.exiting) return;
  xr::toFocused([&](XrSessionState state) { enterState(session, state); });
}

void stop(Session& session) {
  if (!session.running || session.state == XR_SESSION_STATE_STOPPING) return;
  session.exiting = true;
  xr::toStopping(session.state, [&](XrSessionState state) { enterState(session, state); });
  world().changed.notify_all();
}

void harnessGone(Session& session) {
  if (session.harness_gone) return;
  session.harness_gone = true;
  session.instance->harness->lose();
  if (session.running) {
    stop(session);
  } else {
    lose(session);
  }
}

void lose(Session& session) {
  if (session.lost) return;
  session.lost = true;
  session.running = false;
  enterState(session, XR_SESSION_STATE_LOSS_PENDING);
  world().changed.notify_all();
}

void checkHarness(Session& session) {
  const Harness* harness = session.instance->harness.get();
  if (harness != nullptr && harness->lost()) harnessGone(session);
}

void requireAlive(const Session& session) {
  if (session.lost) {
    throw Failure(XR_ERROR_SESSION_LOST, session.harness_gone
                                             ? "the harness is gone or waited in vain; destroy "
                                               "the session"
                                             : "the session is lost");
  }
}

void requireOwn(const Session& session, const Session* parent, std::string_view child) {
  if (parent != &session) invalid(std::string(child) + " belongs to another session");
}

std::shared_ptr<Session> liveSession(XrSession handle) {
  auto session = get<Session>(handle, "session");
  checkHarness(*session);
  requireAlive(*session);
  return session;
}

// Sessions: made, begun, ended.

void leave(Session& session, const char* call) {
  session.destroyed = true;
  world().changed.notify_all();
  if (session.lost) return;
  if (Harness* harness = session.instance->harness.get()) {
    harness->relax();
    harness->ended("the program destroyed its session", call);
  }
}

XrResult XRAPI_CALL calls::xrCreateSession(XrInstance instance,
                                           const XrSessionCreateInfo* createInfo,
                                           XrSession* session) {
  return guarded("xrCreateSession", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    const auto& info = structure(createInfo, XR_TYPE_SESSION_CREATE_INFO, "createInfo");
    requirePointer(session, "session");
    if (info.createFlags != 0) invalid("createInfo->createFlags is not 0");
    if (info.systemId != kSystem || !owner->system_asked) {
      throw Failure(XR_ERROR_SYSTEM_INVALID, fmt::format("no system {}", info.systemId));
    }
    requireOnlySession(*owner);
    auto made = std::make_shared<Session>();
    made->instance = owner;
    makeGraphics(*owner, info, *made);
    if (owner->harness) {
      owner->harness->openSession(made->graphics_name,
                                  owner->enabled("XR_KHR_composition_layer_depth"));
    }
    *session = add<XrSession>(made, owner->handle);
    start(*made);
    if (owner->harness) {
      owner->harness->expect("xrBeginSession", "xrBeginSession did not follow xrCreateSession");
    }
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrDestroySession(XrSession session) {
  return guarded("xrDestroySession", [&](Lock&) {
    const auto gone = get<Session>(session, "session");
    leave(*gone, "xrDestroySession");
    for (const auto& set : gone->action_sets) {
      for (const auto& action : world().handles.below(HandleType::action, set->handle)) {
        static_cast<Action&>(*action).bindings.clear();
        static_cast<Action&>(*action).states = {};
      }
    }
    world().handles.remove(gone->handle);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrBeginSession(XrSession session, const XrSessionBeginInfo* beginInfo) {
  return guarded("xrBeginSession", [&](Lock&) {
    const auto self = liveSession(session);
    const auto& info = structure(beginInfo, XR_TYPE_SESSION_BEGIN_INFO, "beginInfo");
    if (self->running) throw Failure(XR_ERROR_SESSION_RUNNING, "the session runs already");
    if (self->state != XR_SESSION_STATE_READY) {
      throw Failure(XR_ERROR_SESSION_NOT_READY,
                    fmt::format("the session is {}, expected READY", xr::stateName(self->state)));
    }
    if (self->graphics) requireStereo(info.primaryViewConfigurationType);
    self->running = true;
    self->exiting = false;
    if (!self->graphics) runHeadless(*self);
    if (Harness* harness = self->instance->harness.get()) {
      harness->expect("xrWaitFrame", "xrWaitFrame did not follow xrBeginSession");
    }
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrEndSession(XrSession session) {
  return guarded("xrEndSession", [&](Lock&) {
    const auto self = liveSession(session);
    if (!self->running) throw Failure(XR_ERROR_SESSION_NOT_RUNNING, "the session does not run");
    if (self->state != XR_SESSION_STATE_STOPPING) {
      const char* state = xr::stateName(self->state);
      throw Failure(XR_ERROR_SESSION_NOT_STOPPING,
                    fmt::format("the session is {}, expected STOPPING", state));
    }
    self->running = false;
    self->loop.waited = self->loop.begun = false;
    self->loop.done_frames = self->loop.waited_frames;
    world().changed.notify_all();
    if (self->harness_gone) {
      lose(*self);
    } else {
      enterState(*self, XR_SESSION_STATE_IDLE);
      enterState(*self, XR_SESSION_STATE_EXITING);
    }
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrRequestExitSession(XrSession session) {
  return guarded("xrRequestExitSession", [&](Lock&) {
    const auto self = liveSession(session);
    if (!self->running) throw Failure(XR_ERROR_SESSION_NOT_RUNNING, "the session does not run");
    stop(*self);
    if (Harness* harness = self->instance->harness.get()) {
      harness->relax();
      harness->ended("the program asked to leave", "xrRequestExitSession");
    }
    return XR_SUCCESS;
  });
}

}  // namespace sim2vr::openxr

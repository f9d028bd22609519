// SPDX-License-Identifier: Apache-2.0
// Sessions: made, begun, ended.
#include "calls.hpp"
#include "check.hpp"
#include "extensions.hpp"
#include "gate.hpp"
#include "objects.hpp"
#include "session_state.hpp"
#include "sim2vr/xr/session_states.hpp"
#include "system.hpp"

namespace sim2vr::openxr {
namespace {

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

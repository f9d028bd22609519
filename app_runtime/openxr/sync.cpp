// SPDX-License-Identifier: Apache-2.0
// xrSyncActions, and the values of actions as of the latest one.
#include <algorithm>

#include "actions.hpp"
#include "calls.hpp"
#include "check.hpp"
#include "paths.hpp"
#include "session_state.hpp"

namespace sim2vr::openxr {
namespace {

std::vector<xr::ActiveSet> activeSets(const Session& session, const XrActionsSyncInfo& info) {
  std::vector<xr::ActiveSet> active;
  if (info.countActiveActionSets > 0) {
    requirePointer(info.activeActionSets, "syncInfo->activeActionSets");
  }
  for (std::uint32_t i = 0; i < info.countActiveActionSets; ++i) {
    const XrActiveActionSet& each = info.activeActionSets[i];
    auto set = get<ActionSet>(each.actionSet, "activeActionSets[i].actionSet");
    const auto& own = session.action_sets;
    if (std::find(own.begin(), own.end(), set) == own.end()) {
      throw Failure(XR_ERROR_ACTIONSET_NOT_ATTACHED,
                    fmt::format("action set '{}' is not attached", set->name));
    }
    xr::ActiveSet entry{set.get()};
    if (each.subactionPath != XR_NULL_PATH) {
      const std::string& text =
          pathText(*session.instance, each.subactionPath, "activeActionSets[i].subactionPath");
      const auto actions = actionsOf(*set);
      const bool declared = std::any_of(actions.begin(), actions.end(), [&](const auto& action) {
        const auto& paths = action->subactions;
        return std::find(paths.begin(), paths.end(), each.subactionPath) != paths.end();
      });
      if (!declared) {
        throw Failure(XR_ERROR_PATH_UNSUPPORTED,
                      fmt::format("no action of set '{}' was made with '{}'", set->name, text));
      }
      entry.hands = {};
      const auto hand = xr::handOf(text);
      if (hand) entry.hands[static_cast<std::size_t>(*hand)] = true;
    }
    active.push_back(entry);
  }
  return active;
}

void announceProfile(Session& session) {
  if (session.announced_profile == session.profile) return;
  session.announced_profile = session.profile;
  const XrEventDataInteractionProfileChanged event{XR_TYPE_EVENT_DATA_INTERACTION_PROFILE_CHANGED,
                                                   nullptr,
                                                   reinterpret_cast<XrSession>(session.handle)};
  queueEvent(*session.instance, event);
}

/// The value that a program asks for.
const xr::ActionState& stateFor(const Session& session, const XrActionStateGetInfo* getInfo,
                                XrActionType type) {
  const auto& info = structure(getInfo, XR_TYPE_ACTION_STATE_GET_INFO, "getInfo");
  const auto action = attachedAction(session, info.action, type);
  return action->states[subactionIndex(*session.instance, *action, info.subactionPath)];
}

template <class State>
void fill(State& to, const xr::ActionState& state) {
  to.changedSinceLastSync = state.changed ? XR_TRUE : XR_FALSE;
  to.lastChangeTime = state.last_change;
  to.isActive = state.active ? XR_TRUE : XR_FALSE;
}

}  // namespace

XrResult XRAPI_CALL calls::xrSyncActions(XrSession session, const XrActionsSyncInfo* syncInfo) {
  return guarded("xrSyncActions", [&](Lock&) {
    const auto self = liveSession(session);
    const auto& info = structure(syncInfo, XR_TYPE_ACTIONS_SYNC_INFO, "syncInfo");
    std::vector<xr::ActiveSet> active = activeSets(*self, info);
    if (self->attached) announceProfile(*self);
    if (!self->focused()) active.clear();
    std::vector<xr::Action*> actions;
    for (const auto& set : self->action_sets) {
      for (const auto& action : actionsOf(*set)) actions.push_back(action.get());
    }
    const xr::Frame* frame = self->tracking.latest();
    xr::syncActions(actions, active, frame == nullptr ? nullptr : &frame->devices, self->now());
    return self->focused() ? XR_SUCCESS : XR_SESSION_NOT_FOCUSED;
  });
}

XrResult XRAPI_CALL calls::xrGetActionStateBoolean(XrSession session,
                                                   const XrActionStateGetInfo* getInfo,
                                                   XrActionStateBoolean* state) {
  return guarded("xrGetActionStateBoolean", [&](Lock&) {
    const auto self = liveSession(session);
    auto& to = structure(state, XR_TYPE_ACTION_STATE_BOOLEAN, "state");
    const xr::ActionState& found = stateFor(*self, getInfo, XR_ACTION_TYPE_BOOLEAN_INPUT);
    to.currentState = found.pressed() ? XR_TRUE : XR_FALSE;
    fill(to, found);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrGetActionStateFloat(XrSession session,
                                                 const XrActionStateGetInfo* getInfo,
                                                 XrActionStateFloat* state) {
  return guarded("xrGetActionStateFloat", [&](Lock&) {
    const auto self = liveSession(session);
    auto& to = structure(state, XR_TYPE_ACTION_STATE_FLOAT, "state");
    const xr::ActionState& found = stateFor(*self, getInfo, XR_ACTION_TYPE_FLOAT_INPUT);
    to.currentState = found.value.x;
    fill(to, found);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrGetActionStateVector2f(XrSession session,
                                                    const XrActionStateGetInfo* getInfo,
                                                    XrActionStateVector2f* state) {
  return guarded("xrGetActionStateVector2f", [&](Lock&) {
    const auto self = liveSession(session);
    auto& to = structure(state, XR_TYPE_ACTION_STATE_VECTOR2F, "state");
    const xr::ActionState& found = stateFor(*self, getInfo, XR_ACTION_TYPE_VECTOR2F_INPUT);
    to.currentState = found.value;
    fill(to, found);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrGetActionStatePose(XrSession session,
                                                const XrActionStateGetInfo* getInfo,
                                                XrActionStatePose* state) {
  return guarded("xrGetActionStatePose", [&](Lock&) {
    const auto self = liveSession(session);
    auto& to = structure(state, XR_TYPE_ACTION_STATE_POSE, "state");
    to.isActive = stateFor(*self, getInfo, XR_ACTION_TYPE_POSE_INPUT).active ? XR_TRUE : XR_FALSE;
    return XR_SUCCESS;
  });
}

}  // namespace sim2vr::openxr

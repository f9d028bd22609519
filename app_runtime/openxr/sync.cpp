// xrSyncActions, and the values of actions as of the latest one.
#include <algorithm>
#include <cmath>
#include <map>

#include "actions.hpp"
#include "calls.hpp"
#include "check.hpp"
#include "paths.hpp"
#include "session_state.hpp"
#include "tracking.hpp"

namespace sim2vr::openxr {
namespace {

/// An action set that the program wants now, for one hand or for all (2).
struct ActiveSet {
  std::shared_ptr<ActionSet> set;
  int hand = 2;
  bool all = true;
};

std::vector<ActiveSet> activeSets(const Session& session, const XrActionsSyncInfo& info) {
  std::vector<ActiveSet> active;
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
    ActiveSet entry{std::move(set), 2, each.subactionPath == XR_NULL_PATH};
    if (!entry.all) {
      const std::string& text =
          pathText(*session.instance, each.subactionPath, "activeActionSets[i].subactionPath");
      const auto actions = actionsOf(*entry.set);
      const bool declared = std::any_of(actions.begin(), actions.end(), [&](const auto& action) {
        const auto& paths = action->subactions;
        return std::find(paths.begin(), paths.end(), each.subactionPath) != paths.end();
      });
      if (!declared) {
        throw Failure(
            XR_ERROR_PATH_UNSUPPORTED,
            fmt::format("no action of set '{}' was made with '{}'", entry.set->name, text));
      }
      entry.hand = handOf(text);
    }
    active.push_back(std::move(entry));
  }
  return active;
}

bool wants(const std::vector<ActiveSet>& active, const ActionSet& set, int hand) {
  return std::any_of(active.begin(), active.end(), [&](const ActiveSet& each) {
    return each.set.get() == &set && (each.all || each.hand == hand);
  });
}

/// The highest priority of a set that wants each input source now: it alone gets it.
std::map<std::string_view, std::uint32_t> sourcePriorities(const Session& session,
                                                           const std::vector<ActiveSet>& active) {
  std::map<std::string_view, std::uint32_t> priorities;
  for (const auto& set : session.action_sets) {
    for (const auto& action : actionsOf(*set)) {
      for (const Component* component : action->bound) {
        if (!wants(active, *set, component->hand)) continue;
        const auto [entry, added] = priorities.emplace(component->source, set->priority);
        if (!added) entry->second = std::max(entry->second, set->priority);
      }
    }
  }
  return priorities;
}

double magnitude(const XrVector2f& v) { return std::hypot(v.x, v.y); }

/// What several inputs of one action make: the one that is furthest from rest.
void merge(ActionValue& into, const XrVector2f& value) {
  if (!into.active || magnitude(value) > magnitude(into.value)) into.value = value;
  into.active = true;
}

void store(ActionValue& stored, const ActionValue& fresh, XrTime time) {
  const bool differs = fresh.value.x != stored.value.x || fresh.value.y != stored.value.y;
  if (!fresh.active) {
    stored = {};
    return;
  }
  // An action that becomes active has no earlier value to differ from.
  stored.changed = stored.active ? differs : magnitude(fresh.value) > 0.0;
  if (stored.changed) stored.last_change = time;
  stored.value = fresh.value;
  stored.active = true;
}

void sync(Session& session, Action& action, const std::vector<ActiveSet>& active,
          const std::map<std::string_view, std::uint32_t>& priorities) {
  std::array<ActionValue, 4> fresh;
  for (const Component* component : action.bound) {
    if (!wants(active, *action.set, component->hand)) continue;
    if (priorities.at(component->source) > action.set->priority) continue;
    const xr::ControllerState* hand =
        session.history.empty()
            ? nullptr
            : &session.history.back().devices.hands[static_cast<std::size_t>(component->hand)];
    if (hand == nullptr || !hand->active) continue;
    const XrVector2f value = readInput(*component, action.type, *hand);
    merge(fresh[static_cast<std::size_t>(component->hand)], value);
    merge(fresh[2], value);
  }
  for (std::size_t i = 0; i < fresh.size(); ++i) store(action.values[i], fresh[i], session.now());
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
const ActionValue& valueFor(const Session& session, const XrActionStateGetInfo* getInfo,
                            XrActionType type) {
  const auto& info = structure(getInfo, XR_TYPE_ACTION_STATE_GET_INFO, "getInfo");
  const auto action = attachedAction(session, info.action, type);
  return action->values[static_cast<std::size_t>(
      subactionIndex(*session.instance, *action, info.subactionPath))];
}

template <class State>
void fill(State& state, const ActionValue& value) {
  state.changedSinceLastSync = value.changed ? XR_TRUE : XR_FALSE;
  state.lastChangeTime = value.last_change;
  state.isActive = value.active ? XR_TRUE : XR_FALSE;
}

}  // namespace

XrResult XRAPI_CALL calls::xrSyncActions(XrSession session, const XrActionsSyncInfo* syncInfo) {
  return guarded("xrSyncActions", [&](Lock&) {
    const auto self = liveSession(session);
    const auto& info = structure(syncInfo, XR_TYPE_ACTIONS_SYNC_INFO, "syncInfo");
    std::vector<ActiveSet> active = activeSets(*self, info);
    if (self->attached) announceProfile(*self);
    if (!self->focused()) active.clear();
    const auto priorities = sourcePriorities(*self, active);
    for (const auto& set : self->action_sets) {
      for (const auto& action : actionsOf(*set)) sync(*self, *action, active, priorities);
    }
    self->synced = true;
    return self->focused() ? XR_SUCCESS : XR_SESSION_NOT_FOCUSED;
  });
}

XrResult XRAPI_CALL calls::xrGetActionStateBoolean(XrSession session,
                                                   const XrActionStateGetInfo* getInfo,
                                                   XrActionStateBoolean* state) {
  return guarded("xrGetActionStateBoolean", [&](Lock&) {
    const auto self = liveSession(session);
    auto& to = structure(state, XR_TYPE_ACTION_STATE_BOOLEAN, "state");
    const ActionValue& value = valueFor(*self, getInfo, XR_ACTION_TYPE_BOOLEAN_INPUT);
    to.currentState = value.value.x > 0.0F ? XR_TRUE : XR_FALSE;
    fill(to, value);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrGetActionStateFloat(XrSession session,
                                                 const XrActionStateGetInfo* getInfo,
                                                 XrActionStateFloat* state) {
  return guarded("xrGetActionStateFloat", [&](Lock&) {
    const auto self = liveSession(session);
    auto& to = structure(state, XR_TYPE_ACTION_STATE_FLOAT, "state");
    const ActionValue& value = valueFor(*self, getInfo, XR_ACTION_TYPE_FLOAT_INPUT);
    to.currentState = value.value.x;
    fill(to, value);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrGetActionStateVector2f(XrSession session,
                                                    const XrActionStateGetInfo* getInfo,
                                                    XrActionStateVector2f* state) {
  return guarded("xrGetActionStateVector2f", [&](Lock&) {
    const auto self = liveSession(session);
    auto& to = structure(state, XR_TYPE_ACTION_STATE_VECTOR2F, "state");
    const ActionValue& value = valueFor(*self, getInfo, XR_ACTION_TYPE_VECTOR2F_INPUT);
    to.currentState = value.value;
    fill(to, value);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrGetActionStatePose(XrSession session,
                                                const XrActionStateGetInfo* getInfo,
                                                XrActionStatePose* state) {
  return guarded("xrGetActionStatePose", [&](Lock&) {
    const auto self = liveSession(session);
    auto& to = structure(state, XR_TYPE_ACTION_STATE_POSE, "state");
    to.isActive = valueFor(*self, getInfo, XR_ACTION_TYPE_POSE_INPUT).active ? XR_TRUE : XR_FALSE;
    return XR_SUCCESS;
  });
}

}  // namespace sim2vr::openxr

// SPDX-License-Identifier: Apache-2.0
// Paths: strings that the specification's rules allow, and the numbers that stand for them.
#include "actions.hpp"

#include <algorithm>
#include <utility>

#include "calls.hpp"
#include "check.hpp"
#include "session.hpp"

namespace sim2vr::openxr {
namespace {

constexpr std::size_t kMaximumPaths = 100'000;

/// "/" and names.
bool isPath(std::string_view text) {
  if (text.size() < 2 || text.front() != '/' || text.back() == '/') return false;
  std::size_t begin = 1;
  while (begin <= text.size()) {
    const std::size_t end = std::min(text.find('/', begin), text.size());
    if (!xr::isName(text.substr(begin, end - begin))) return false;
    begin = end + 1;
  }
  return true;
}

void requireName(std::string_view name, std::string_view localized, const char* what) {
  if (!xr::isName(name)) {
    throw Failure(name.empty() ? XR_ERROR_NAME_INVALID : XR_ERROR_PATH_FORMAT_INVALID,
                  fmt::format("{} '{}', expected characters a-z 0-9 - _ .", what, name));
  }
  if (localized.empty()) {
    throw Failure(XR_ERROR_LOCALIZED_NAME_INVALID,
                  fmt::format("{} '{}' has no localized name", what, name));
  }
}

/// Names of siblings differ.
template <class T>
void requireUnique(const std::vector<std::shared_ptr<Object>>& siblings, std::string_view name,
                   std::string_view localized) {
  for (const auto& object : siblings) {
    const auto& other = static_cast<const T&>(*object);
    if (other.name == name) {
      throw Failure(XR_ERROR_NAME_DUPLICATED, fmt::format("'{}' exists already", name));
    }
    if (other.localized_name == localized) {
      throw Failure(XR_ERROR_LOCALIZED_NAME_DUPLICATED,
                    fmt::format("localized name '{}' exists already", localized));
    }
  }
}

std::vector<XrPath> subactionPaths(const Instance& instance, const XrActionCreateInfo& info) {
  std::vector<XrPath> paths;
  if (info.countSubactionPaths > 0)
    requirePointer(info.subactionPaths, "createInfo->subactionPaths");
  for (std::uint32_t i = 0; i < info.countSubactionPaths; ++i) {
    const XrPath path = info.subactionPaths[i];
    const std::string& text = pathText(instance, path, "createInfo->subactionPaths[i]");
    if (!isTopLevel(text) || std::find(paths.begin(), paths.end(), path) != paths.end()) {
      throw Failure(
          XR_ERROR_PATH_UNSUPPORTED,
          fmt::format("subaction path '{}', expected each of /user/hand/left and the like "
                      "once",
                      text));
    }
    paths.push_back(path);
  }
  return paths;
}

std::shared_ptr<Instance> instanceOf(const Object& child) {
  return std::static_pointer_cast<Instance>(
      world().handles.find(HandleType::instance, child.parent));
}

const xr::Profile& profileOf(const Instance& instance, XrPath path) {
  const std::string& text = pathText(instance, path, "interactionProfile");
  const xr::Profile* profile = xr::findProfile(text);
  if (profile == nullptr || (profile->since_11 && instance.version < kVersion11)) {
    throw Failure(XR_ERROR_PATH_UNSUPPORTED, fmt::format("no interaction profile '{}'", text));
  }
  return *profile;
}

std::vector<SuggestedBinding> checkedBindings(const Instance& instance, const xr::Profile& profile,
                                              const XrInteractionProfileSuggestedBinding& info) {
  std::vector<SuggestedBinding> bindings;
  for (std::uint32_t i = 0; i < info.countSuggestedBindings; ++i) {
    const XrActionSuggestedBinding& each = info.suggestedBindings[i];
    auto action = get<Action>(each.action, "suggestedBindings[i].action");
    const std::string& text = pathText(instance, each.binding, "suggestedBindings[i].binding");
    const bool since_11 = text.ends_with("/grip_surface/pose");
    if (profile.find(text) == nullptr || (since_11 && instance.version < kVersion11)) {
      throw Failure(XR_ERROR_PATH_UNSUPPORTED, fmt::format("{} has no '{}'", profile.path, text));
    }
    if (action->set->attached) {
      throw Failure(XR_ERROR_ACTIONSETS_ALREADY_ATTACHED,
                    fmt::format("action set '{}' is attached", action->set->name));
    }
    bindings.push_back({std::move(action), each.binding});
  }
  return bindings;
}

/// The simulated controllers' own profile where the program has suggestions for it, else the first
/// of our table that it has some for, as runtimes do for controllers that a program does not know.
XrPath chosenProfile(Instance& instance) {
  const auto suggested = [&](const std::string& path) {
    const auto found = instance.paths.find(path);
    return found != instance.paths.end() && instance.suggested.contains(found->second)
               ? found->second
               : XR_NULL_PATH;
  };
  if (const XrPath own = suggested(instance.config.profile); own != XR_NULL_PATH) return own;
  // Rich controllers before plain ones: the simple controller is the last resort.
  const auto& all = xr::profiles();
  for (auto profile = all.begin() + 1; profile != all.end(); ++profile) {
    if (!profile->components.front().hand) continue;
    if (const XrPath path = suggested(profile->path); path != XR_NULL_PATH) return path;
  }
  return suggested(all.front().path);
}

bool hasHand(const Instance& instance, std::optional<xr::Hand> hand) {
  if (!hand) return false;
  return *hand == xr::Hand::left ? instance.config.left_hand : instance.config.right_hand;
}

std::string localizedSource(const xr::Component& component) {
  const std::size_t slash = component.source.rfind('/');
  std::string name = component.source.substr(slash + 1);
  bool first = true;
  for (char& c : name) {
    if (c == '_') {
      c = ' ';
      first = true;
    } else if (first) {
      c = static_cast<char>(c >= 'a' && c <= 'z' ? c - 'a' + 'A' : c);
      first = false;
    }
  }
  return name;
}

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

/// Sends one event per hand that the action is bound to.
void vibrate(Session& session, const Action& action, std::size_t hand,
             const XrHapticVibration& vibration) {
  Harness* harness = session.instance->harness.get();
  if (harness == nullptr) return;
  std::array<bool, 2> done{};
  for (const xr::Component* component : action.bindings) {
    const auto own = static_cast<std::size_t>(*component->hand);
    if ((hand != xr::kBothHands && own != hand) || std::exchange(done[own], true)) continue;
    harness->note({.kind = "haptic",
                   .text = own == 0 ? "left" : "right",
                   .amplitude = vibration.amplitude,
                   .frequency_hz = vibration.frequency,
                   .duration_ns = vibration.duration,
                   .time_ns = session.now()});
  }
}

XrResult vibrate(XrSession session, const XrHapticActionInfo* actionInfo,
                 const XrHapticVibration& vibration) {
  const auto self = liveSession(session);
  const auto& info = structure(actionInfo, XR_TYPE_HAPTIC_ACTION_INFO, "hapticActionInfo");
  const auto action = attachedAction(*self, info.action, XR_ACTION_TYPE_VIBRATION_OUTPUT);
  const std::size_t hand = subactionIndex(*self->instance, *action, info.subactionPath);
  if (!self->focused()) return XR_SESSION_NOT_FOCUSED;
  vibrate(*self, *action, hand, vibration);
  return XR_SUCCESS;
}

}  // namespace

XrPath toPath(Instance& instance, std::string_view text) {
  const auto found = instance.paths.find(std::string(text));
  if (found != instance.paths.end()) return found->second;
  if (instance.path_texts.size() >= kMaximumPaths) {
    throw Failure(XR_ERROR_PATH_COUNT_EXCEEDED, "100000 paths exist");
  }
  instance.path_texts.emplace_back(text);
  const XrPath path = instance.path_texts.size();
  instance.paths.emplace(text, path);
  return path;
}

const std::string& pathText(const Instance& instance, XrPath path, const char* what) {
  if (path == XR_NULL_PATH || path > instance.path_texts.size()) {
    throw Failure(XR_ERROR_PATH_INVALID,
                  fmt::format("{} is {}, no path of this instance", what, path));
  }
  return instance.path_texts[path - 1];
}

XrResult XRAPI_CALL calls::xrStringToPath(XrInstance instance, const char* pathString,
                                          XrPath* path) {
  return guarded("xrStringToPath", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    requirePointer(pathString, "pathString");
    requirePointer(path, "path");
    const std::string_view text(pathString, ::strnlen(pathString, XR_MAX_PATH_LENGTH + 1));
    if (text.size() >= XR_MAX_PATH_LENGTH || !isPath(text)) {
      throw Failure(XR_ERROR_PATH_FORMAT_INVALID,
                    fmt::format("'{}' is no path", text.substr(0, 80)));
    }
    *path = toPath(*owner, text);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrPathToString(XrInstance instance, XrPath path,
                                          uint32_t bufferCapacityInput, uint32_t* bufferCountOutput,
                                          char* buffer) {
  return guarded("xrPathToString", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    return fillText(pathText(*owner, path, "path"), bufferCapacityInput, bufferCountOutput, buffer);
  });
}

// Action sets and actions: made by the instance, attached to the session.

bool isTopLevel(std::string_view path) {
  return path == "/user/hand/left" || path == "/user/hand/right" || path == "/user/head" ||
         path == "/user/gamepad" || path == "/user/treadmill";
}

std::size_t subactionIndex(const Instance& instance, const Action& action, XrPath subaction) {
  if (subaction == XR_NULL_PATH) return xr::kBothHands;
  const std::string& text = pathText(instance, subaction, "subactionPath");
  const auto& own = action.subactions;
  if (std::find(own.begin(), own.end(), subaction) == own.end()) {
    throw Failure(XR_ERROR_PATH_UNSUPPORTED,
                  fmt::format("action '{}' was made without '{}'", action.name, text));
  }
  const std::optional<xr::Hand> hand = xr::handOf(text);
  return hand ? static_cast<std::size_t>(*hand) : xr::kOtherDevice;
}

std::shared_ptr<Action> attachedAction(const Session& session, XrAction handle, XrActionType type) {
  auto action = get<Action>(handle, "action");
  const auto& sets = session.action_sets;
  if (std::find(sets.begin(), sets.end(), action->owner) == sets.end()) {
    throw Failure(XR_ERROR_ACTIONSET_NOT_ATTACHED,
                  fmt::format("action set '{}' is not attached", action->set->name));
  }
  if (action->type != type) {
    throw Failure(XR_ERROR_ACTION_TYPE_MISMATCH,
                  fmt::format("action '{}' has type {}, expected {}", action->name,
                              static_cast<int>(action->type), static_cast<int>(type)));
  }
  return action;
}

std::vector<std::shared_ptr<Action>> actionsOf(const ActionSet& set) {
  std::vector<std::shared_ptr<Action>> actions;
  for (const auto& object : world().handles.below(HandleType::action, set.handle)) {
    actions.push_back(std::static_pointer_cast<Action>(object));
  }
  return actions;
}

XrResult XRAPI_CALL calls::xrCreateActionSet(XrInstance instance,
                                             const XrActionSetCreateInfo* createInfo,
                                             XrActionSet* actionSet) {
  return guarded("xrCreateActionSet", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    const auto& info = structure(createInfo, XR_TYPE_ACTION_SET_CREATE_INFO, "createInfo");
    requirePointer(actionSet, "actionSet");
    auto made = std::make_shared<ActionSet>();
    made->name = boundedText(info.actionSetName, "actionSetName");
    made->localized_name = boundedText(info.localizedActionSetName, "localizedActionSetName");
    made->priority = info.priority;
    requireName(made->name, made->localized_name, "action set");
    requireUnique<ActionSet>(world().handles.below(HandleType::action_set, owner->handle),
                             made->name, made->localized_name);
    *actionSet = add<XrActionSet>(made, owner->handle);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrDestroyActionSet(XrActionSet actionSet) {
  return guarded("xrDestroyActionSet", [&](Lock&) {
    world().handles.remove(get<ActionSet>(actionSet, "actionSet")->handle);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrCreateAction(XrActionSet actionSet,
                                          const XrActionCreateInfo* createInfo, XrAction* action) {
  return guarded("xrCreateAction", [&](Lock&) {
    const auto set = get<ActionSet>(actionSet, "actionSet");
    const auto& info = structure(createInfo, XR_TYPE_ACTION_CREATE_INFO, "createInfo");
    requirePointer(action, "action");
    if (set->attached) {
      throw Failure(XR_ERROR_ACTIONSETS_ALREADY_ATTACHED,
                    fmt::format("action set '{}' is attached", set->name));
    }
    auto made = std::make_shared<Action>();
    made->owner = set;
    made->set = set.get();
    made->name = boundedText(info.actionName, "actionName");
    made->localized_name = boundedText(info.localizedActionName, "localizedActionName");
    made->type = info.actionType;
    requireName(made->name, made->localized_name, "action");
    requireUnique<Action>(world().handles.below(HandleType::action, set->handle), made->name,
                          made->localized_name);
    if (xr::typeName(info.actionType) == nullptr) {
      invalid(fmt::format("createInfo->actionType is {}", static_cast<int>(info.actionType)));
    }
    const auto instance = instanceOf(*set);
    made->subactions = subactionPaths(*instance, info);
    if (!made->subactions.empty()) made->hands = {};
    for (const XrPath path : made->subactions) {
      const auto hand = xr::handOf(pathText(*instance, path, "subaction"));
      if (hand) made->hands[static_cast<std::size_t>(*hand)] = true;
    }
    *action = add<XrAction>(made, set->handle);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrDestroyAction(XrAction action) {
  return guarded("xrDestroyAction", [&](Lock&) {
    world().handles.remove(get<Action>(action, "action")->handle);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrAttachSessionActionSets(
    XrSession session, const XrSessionActionSetsAttachInfo* attachInfo) {
  return guarded("xrAttachSessionActionSets", [&](Lock&) {
    const auto self = liveSession(session);
    const auto& info = structure(attachInfo, XR_TYPE_SESSION_ACTION_SETS_ATTACH_INFO, "attachInfo");
    if (info.countActionSets == 0) invalid("attachInfo->countActionSets is 0");
    requirePointer(info.actionSets, "attachInfo->actionSets");
    std::vector<std::shared_ptr<ActionSet>> sets;
    for (std::uint32_t i = 0; i < info.countActionSets; ++i) {
      sets.push_back(get<ActionSet>(info.actionSets[i], "attachInfo->actionSets[i]"));
    }
    if (self->attached) {
      throw Failure(XR_ERROR_ACTIONSETS_ALREADY_ATTACHED, "the session has its action sets");
    }
    for (const auto& set : sets) set->attached = true;
    self->action_sets = std::move(sets);
    self->attached = true;
    bindActions(*self);
    return XR_SUCCESS;
  });
}

// Suggested bindings, which of them apply, and what the program is told about them.

void bindActions(Session& session) {
  Instance& instance = *session.instance;
  session.profile = chosenProfile(instance);
  if (session.profile == XR_NULL_PATH) return;
  const xr::Profile& profile = profileOf(instance, session.profile);
  for (const SuggestedBinding& binding : instance.suggested[session.profile]) {
    Action& action = *binding.action;
    const auto& sets = session.action_sets;
    if (std::find(sets.begin(), sets.end(), action.owner) == sets.end()) continue;
    const xr::Component* component = profile.find(pathText(instance, binding.path, "binding"));
    if (component != nullptr && hasHand(instance, component->hand)) action.bind(*component);
  }
}

XrResult XRAPI_CALL calls::xrSuggestInteractionProfileBindings(
    XrInstance instance, const XrInteractionProfileSuggestedBinding* suggestedBindings) {
  return guarded("xrSuggestInteractionProfileBindings", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    const auto& info = structure(suggestedBindings, XR_TYPE_INTERACTION_PROFILE_SUGGESTED_BINDING,
                                 "suggestedBindings");
    if (info.countSuggestedBindings == 0) invalid("countSuggestedBindings is 0");
    requirePointer(info.suggestedBindings, "suggestedBindings->suggestedBindings");
    const xr::Profile& profile = profileOf(*owner, info.interactionProfile);
    owner->suggested[info.interactionProfile] = checkedBindings(*owner, profile, info);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrGetCurrentInteractionProfile(
    XrSession session, XrPath topLevelUserPath, XrInteractionProfileState* interactionProfile) {
  return guarded("xrGetCurrentInteractionProfile", [&](Lock&) {
    const auto self = liveSession(session);
    auto& to =
        structure(interactionProfile, XR_TYPE_INTERACTION_PROFILE_STATE, "interactionProfile");
    const std::string& text = pathText(*self->instance, topLevelUserPath, "topLevelUserPath");
    if (!isTopLevel(text)) {
      throw Failure(XR_ERROR_PATH_UNSUPPORTED, fmt::format("'{}' is no top level user path", text));
    }
    if (!self->attached) {
      throw Failure(XR_ERROR_ACTIONSET_NOT_ATTACHED, "no action set is attached");
    }
    const bool present = hasHand(*self->instance, xr::handOf(text));
    to.interactionProfile = present ? self->announced_profile : XR_NULL_PATH;
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrEnumerateBoundSourcesForAction(
    XrSession session, const XrBoundSourcesForActionEnumerateInfo* enumerateInfo,
    uint32_t sourceCapacityInput, uint32_t* sourceCountOutput, XrPath* sources) {
  return guarded("xrEnumerateBoundSourcesForAction", [&](Lock&) {
    const auto self = liveSession(session);
    const auto& info =
        structure(enumerateInfo, XR_TYPE_BOUND_SOURCES_FOR_ACTION_ENUMERATE_INFO, "enumerateInfo");
    const auto type = get<Action>(info.action, "enumerateInfo->action")->type;
    const auto action = attachedAction(*self, info.action, type);
    std::vector<XrPath> paths;
    for (const xr::Component* component : action->bindings) {
      paths.push_back(toPath(*self->instance, component->path));
    }
    return fillItems(std::span<const XrPath>(paths), sourceCapacityInput, sourceCountOutput,
                     sources, "sources");
  });
}

XrResult XRAPI_CALL calls::xrGetInputSourceLocalizedName(
    XrSession session, const XrInputSourceLocalizedNameGetInfo* getInfo,
    uint32_t bufferCapacityInput, uint32_t* bufferCountOutput, char* buffer) {
  return guarded("xrGetInputSourceLocalizedName", [&](Lock&) {
    const auto self = liveSession(session);
    const auto& info = structure(getInfo, XR_TYPE_INPUT_SOURCE_LOCALIZED_NAME_GET_INFO, "getInfo");
    constexpr XrInputSourceLocalizedNameFlags kAll =
        XR_INPUT_SOURCE_LOCALIZED_NAME_USER_PATH_BIT |
        XR_INPUT_SOURCE_LOCALIZED_NAME_INTERACTION_PROFILE_BIT |
        XR_INPUT_SOURCE_LOCALIZED_NAME_COMPONENT_BIT;
    if (info.whichComponents == 0 || (info.whichComponents & ~kAll) != 0) {
      invalid(fmt::format("getInfo->whichComponents is {}", info.whichComponents));
    }
    const std::string& text = pathText(*self->instance, info.sourcePath, "getInfo->sourcePath");
    if (!self->attached) {
      throw Failure(XR_ERROR_ACTIONSET_NOT_ATTACHED, "no action set is attached");
    }
    const xr::Profile* profile =
        self->profile == XR_NULL_PATH ? nullptr : &profileOf(*self->instance, self->profile);
    const xr::Component* component = profile == nullptr ? nullptr : profile->find(text);
    if (component == nullptr) {
      throw Failure(XR_ERROR_PATH_UNSUPPORTED, fmt::format("'{}' is no bound source", text));
    }
    std::string name;
    const auto append = [&](XrInputSourceLocalizedNameFlags bit, const std::string& part) {
      if ((info.whichComponents & bit) != 0) name += (name.empty() ? "" : " ") + part;
    };
    append(XR_INPUT_SOURCE_LOCALIZED_NAME_USER_PATH_BIT,
           component->hand == xr::Hand::left ? "Left Hand" : "Right Hand");
    append(XR_INPUT_SOURCE_LOCALIZED_NAME_INTERACTION_PROFILE_BIT, profile->localized_name);
    append(XR_INPUT_SOURCE_LOCALIZED_NAME_COMPONENT_BIT, localizedSource(*component));
    return fillText(name, bufferCapacityInput, bufferCountOutput, buffer);
  });
}

// xrSyncActions, and the values of actions as of the latest one.

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

// Vibrations that the program asks for: they go to the harness with the frame's time.

XrResult XRAPI_CALL calls::xrApplyHapticFeedback(XrSession session,
                                                 const XrHapticActionInfo* hapticActionInfo,
                                                 const XrHapticBaseHeader* hapticFeedback) {
  return guarded("xrApplyHapticFeedback", [&](Lock&) {
    get<Session>(session, "session");
    requirePointer(hapticFeedback, "hapticFeedback");
    const auto& vibration = structure(reinterpret_cast<const XrHapticVibration*>(hapticFeedback),
                                      XR_TYPE_HAPTIC_VIBRATION, "hapticFeedback");
    if (!xr::isVibration(vibration)) {
      invalid(
          fmt::format("hapticFeedback has amplitude {}, frequency {} and duration {}, expected "
                      "0 to 1, 0 or more and -1 or more",
                      vibration.amplitude, vibration.frequency, vibration.duration));
    }
    return vibrate(session, hapticActionInfo, vibration);
  });
}

XrResult XRAPI_CALL calls::xrStopHapticFeedback(XrSession session,
                                                const XrHapticActionInfo* hapticActionInfo) {
  return guarded("xrStopHapticFeedback", [&](Lock&) {
    return vibrate(session, hapticActionInfo, {XR_TYPE_HAPTIC_VIBRATION, nullptr, 0, 0.0F, 0.0F});
  });
}

}  // namespace sim2vr::openxr

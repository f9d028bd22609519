// SPDX-License-Identifier: Apache-2.0
// Action sets and actions: made by the instance, attached to the session.
#include "actions.hpp"

#include <algorithm>

#include "calls.hpp"
#include "check.hpp"
#include "paths.hpp"
#include "session_state.hpp"

namespace sim2vr::openxr {
namespace {

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

}  // namespace

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

}  // namespace sim2vr::openxr

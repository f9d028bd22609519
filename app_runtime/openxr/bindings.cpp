// SPDX-License-Identifier: Apache-2.0
// Suggested bindings, which of them apply, and what the program is told about them.
#include <algorithm>

#include "actions.hpp"
#include "calls.hpp"
#include "check.hpp"
#include "paths.hpp"
#include "session_state.hpp"

namespace sim2vr::openxr {
namespace {

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

}  // namespace

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

}  // namespace sim2vr::openxr

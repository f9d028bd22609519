// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstdio>
#include <cstring>
#include <optional>

#include "layer.hpp"
#include "sim2vr/xr/profiles.hpp"

namespace sim2vr::openxr::layer {
namespace {

bool tracked(XrSpaceLocationFlags flags) {
  constexpr XrSpaceLocationFlags kValid =
      XR_SPACE_LOCATION_ORIENTATION_VALID_BIT | XR_SPACE_LOCATION_POSITION_VALID_BIT;
  return (flags & kValid) == kValid;
}

}  // namespace

bool Next::fill() {
  bool all = get != nullptr;
  const auto find = [&](const char* name) {
    PFN_xrVoidFunction found = nullptr;
    all = all && get(instance, name, &found) == XR_SUCCESS && found != nullptr;
    return found;
  };
#define SIM2VR_FIND(name) name = reinterpret_cast<PFN_##name>(find(#name));
  SIM2VR_LAYER_FUNCTIONS(SIM2VR_FIND)
#undef SIM2VR_FIND
  return all;
}

XrPath Next::path(const std::string& text) const {
  XrPath path = XR_NULL_PATH;
  xrStringToPath(instance, text.c_str(), &path);
  return path;
}

XrAction OwnActions::make(const Next& next, const char* name, XrActionType type) const {
  XrActionCreateInfo info{};
  info.type = XR_TYPE_ACTION_CREATE_INFO;
  std::snprintf(info.actionName, sizeof info.actionName, "%s", name);
  std::snprintf(info.localizedActionName, sizeof info.localizedActionName, "Recorded %s", name);
  info.actionType = type;
  info.countSubactionPaths = 2;
  info.subactionPaths = hands_.data();
  XrAction action = XR_NULL_HANDLE;
  return next.xrCreateAction(set_, &info, &action) == XR_SUCCESS ? action : XR_NULL_HANDLE;
}

bool OwnActions::create(const Next& next) {
  if (set_ != XR_NULL_HANDLE) return true;
  hands_ = {next.path("/user/hand/left"), next.path("/user/hand/right")};
  XrActionSetCreateInfo info{};
  info.type = XR_TYPE_ACTION_SET_CREATE_INFO;
  std::strcpy(info.actionSetName, "sim2vr_recording");
  std::strcpy(info.localizedActionSetName, "SIM2VR recording");
  if (next.xrCreateActionSet(next.instance, &info, &set_) != XR_SUCCESS) {
    set_ = XR_NULL_HANDLE;
    return false;
  }
  actions_[grip] = make(next, "grip", XR_ACTION_TYPE_POSE_INPUT);
  actions_[aim] = make(next, "aim", XR_ACTION_TYPE_POSE_INPUT);
  actions_[trigger] = make(next, "trigger", XR_ACTION_TYPE_FLOAT_INPUT);
  actions_[squeeze] = make(next, "squeeze", XR_ACTION_TYPE_FLOAT_INPUT);
  actions_[stick] = make(next, "stick", XR_ACTION_TYPE_VECTOR2F_INPUT);
  actions_[stick_click] = make(next, "stick_click", XR_ACTION_TYPE_BOOLEAN_INPUT);
  actions_[lower] = make(next, "lower", XR_ACTION_TYPE_BOOLEAN_INPUT);
  actions_[upper] = make(next, "upper", XR_ACTION_TYPE_BOOLEAN_INPUT);
  actions_[menu] = make(next, "menu", XR_ACTION_TYPE_BOOLEAN_INPUT);
  return true;
}

std::vector<XrActionSuggestedBinding> OwnActions::withOurs(
    const Next& next, const XrInteractionProfileSuggestedBinding& suggested) const {
  std::vector<XrActionSuggestedBinding> bindings(
      suggested.suggestedBindings, suggested.suggestedBindings + suggested.countSuggestedBindings);
  char text[XR_MAX_PATH_LENGTH]{};
  std::uint32_t count = 0;
  next.xrPathToString(next.instance, suggested.interactionProfile, sizeof text, &count, text);
  const xr::Profile* profile = xr::findProfile(text);
  if (profile == nullptr) return bindings;
  const auto kindOf = [](xr::Input input) -> std::optional<Kind> {
    switch (input) {
      case xr::Input::grip_pose:
        return grip;
      case xr::Input::aim_pose:
        return aim;
      case xr::Input::trigger:
        return trigger;
      case xr::Input::squeeze:
        return squeeze;
      case xr::Input::stick:
        return stick;
      case xr::Input::stick_click:
        return stick_click;
      case xr::Input::lower:
        return lower;
      case xr::Input::upper:
        return upper;
      case xr::Input::menu:
        return menu;
      default:
        return std::nullopt;
    }
  };
  for (const xr::Component& component : profile->components) {
    const auto kind = kindOf(component.input);
    // Of 1.1 only.
    if (!kind || component.path.ends_with("/grip_surface/pose")) continue;
    if (actions_[*kind] == XR_NULL_HANDLE) continue;
    bindings.push_back({actions_[*kind], next.path(component.path)});
  }
  return bindings;
}

void OwnActions::attach(const Next& next, XrSession session) {
  attached_ = true;
  spaces_ = {};
  for (std::size_t kind = 0; kind < 2; ++kind) {
    for (std::size_t hand = 0; hand < 2; ++hand) {
      const XrActionSpaceCreateInfo info{XR_TYPE_ACTION_SPACE_CREATE_INFO, nullptr, actions_[kind],
                                         hands_[hand], xr::kIdentityPose};
      next.xrCreateActionSpace(session, &info, &spaces_[kind][hand]);
    }
  }
}

xr::ControllerState OwnActions::read(const Next& next, XrSession session, xr::Hand which,
                                     XrSpace base, XrTime time) const {
  const auto hand = static_cast<std::size_t>(which);
  xr::ControllerState state;
  const auto locate = [&](Kind kind, XrPosef& pose) {
    XrSpaceLocation location{XR_TYPE_SPACE_LOCATION, nullptr, 0, xr::kIdentityPose};
    if (next.xrLocateSpace(spaces_[kind][hand], base, time, &location) != XR_SUCCESS) {
      return false;
    }
    pose = location.pose;
    return tracked(location.locationFlags);
  };
  state.active = locate(grip, state.grip);
  if (!state.active) return state;
  if (!locate(aim, state.aim)) state.aim = xr::compose(state.grip, xr::kGripToAim);
  const auto number = [&](Kind kind) {
    const XrActionStateGetInfo info{XR_TYPE_ACTION_STATE_GET_INFO, nullptr, actions_[kind],
                                    hands_[hand]};
    XrActionStateFloat value{XR_TYPE_ACTION_STATE_FLOAT, nullptr, 0.0F, 0, 0, 0};
    next.xrGetActionStateFloat(session, &info, &value);
    return std::isfinite(value.currentState) ? value.currentState : 0.0F;
  };
  const auto pressed = [&](Kind kind) {
    const XrActionStateGetInfo info{XR_TYPE_ACTION_STATE_GET_INFO, nullptr, actions_[kind],
                                    hands_[hand]};
    XrActionStateBoolean value{XR_TYPE_ACTION_STATE_BOOLEAN, nullptr, 0, 0, 0, 0};
    next.xrGetActionStateBoolean(session, &info, &value);
    return value.currentState == XR_TRUE;
  };
  state.trigger = number(trigger);
  state.squeeze = number(squeeze);
  const XrActionStateGetInfo info{XR_TYPE_ACTION_STATE_GET_INFO, nullptr, actions_[stick],
                                  hands_[hand]};
  XrActionStateVector2f vector{XR_TYPE_ACTION_STATE_VECTOR2F, nullptr, {0, 0}, 0, 0, 0};
  next.xrGetActionStateVector2f(session, &info, &vector);
  state.thumbstick = vector.currentState;
  state.thumbstick_click = pressed(stick_click);
  (which == xr::Hand::left ? state.x : state.a) = pressed(lower);
  (which == xr::Hand::left ? state.y : state.b) = pressed(upper);
  state.menu = which == xr::Hand::left && pressed(menu);
  return state;
}

}  // namespace sim2vr::openxr::layer

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/xr/profiles.hpp"

#include <algorithm>
#include <array>

namespace sim2vr::xr {
namespace {

// A number presses a button from its middle on.
constexpr float kPressed = 0.5F;

struct ProfileText {
  std::string_view path;
  std::string_view name;
  bool since_11;
  std::string_view both;  // for each hand, below input/ unless it begins with output/
  std::string_view left;
  std::string_view right;
};

#define SIM2VR_POSES "grip/pose aim/pose output/haptic "
#define SIM2VR_STICK "thumbstick thumbstick/x thumbstick/y thumbstick/click "
#define SIM2VR_PAD "trackpad trackpad/x trackpad/y trackpad/click trackpad/touch "
#define SIM2VR_XY "x/click y/click "
#define SIM2VR_AB "a/click b/click "
#define SIM2VR_XY_TOUCH SIM2VR_XY "x/touch y/touch "
#define SIM2VR_AB_TOUCH SIM2VR_AB "a/touch b/touch "
#define SIM2VR_TOUCH        \
  SIM2VR_POSES SIM2VR_STICK \
      "thumbstick/touch squeeze/value trigger/value trigger/touch thumbrest/touch "
#define SIM2VR_META SIM2VR_TOUCH "trigger/proximity thumb_resting_surfaces/proximity "

constexpr std::array kProfiles = std::to_array<ProfileText>({
    {"khr/simple_controller", "Simple Controller", false, SIM2VR_POSES "select/click menu/click",
     "", ""},
    {"oculus/touch_controller", "Touch Controller", false, SIM2VR_TOUCH,
     SIM2VR_XY_TOUCH "menu/click", SIM2VR_AB_TOUCH "system/click"},
    {"valve/index_controller", "Index Controller", false,
     SIM2VR_POSES SIM2VR_STICK SIM2VR_AB_TOUCH
     "thumbstick/touch system/click system/touch squeeze/value squeeze/force trigger/click "
     "trigger/value trigger/touch trackpad trackpad/x trackpad/y trackpad/force trackpad/touch",
     "", ""},
    {"htc/vive_controller", "Vive Controller", false,
     SIM2VR_POSES SIM2VR_PAD "system/click squeeze/click menu/click trigger/click trigger/value",
     "", ""},
    {"google/daydream_controller", "Daydream Controller", false,
     "grip/pose aim/pose select/click " SIM2VR_PAD, "", ""},
    {"microsoft/motion_controller", "Motion Controller", false,
     SIM2VR_POSES SIM2VR_STICK SIM2VR_PAD "menu/click squeeze/click trigger/value", "", ""},
    {"oculus/go_controller", "Go Controller", false,
     "grip/pose aim/pose system/click back/click trigger/click " SIM2VR_PAD, "", ""},
    {"bytedance/pico_neo3_controller", "Neo3 Controller", true,
     SIM2VR_POSES SIM2VR_STICK
     "thumbstick/touch menu/click system/click trigger/click trigger/value trigger/touch "
     "squeeze/click squeeze/value",
     SIM2VR_XY_TOUCH, SIM2VR_AB_TOUCH},
    {"bytedance/pico4_controller", "Pico 4 Controller", true,
     SIM2VR_POSES SIM2VR_STICK
     "thumbstick/touch system/click trigger/click trigger/value trigger/touch squeeze/click "
     "squeeze/value",
     SIM2VR_XY_TOUCH "menu/click", SIM2VR_AB_TOUCH},
    {"bytedance/pico_g3_controller", "Pico G3 Controller", true,
     "grip/pose aim/pose trigger/click trigger/value menu/click " SIM2VR_STICK, "", ""},
    {"hp/mixed_reality_controller", "Mixed Reality Controller", true,
     SIM2VR_POSES SIM2VR_STICK "menu/click squeeze/value trigger/value", SIM2VR_XY, SIM2VR_AB},
    {"htc/vive_cosmos_controller", "Vive Cosmos Controller", true,
     SIM2VR_POSES SIM2VR_STICK
     "thumbstick/touch shoulder/click squeeze/click trigger/click trigger/value",
     SIM2VR_XY "menu/click", SIM2VR_AB "system/click"},
    {"htc/vive_focus3_controller", "Vive Focus 3 Controller", true,
     SIM2VR_POSES SIM2VR_STICK
     "thumbstick/touch squeeze/click squeeze/touch squeeze/value trigger/click trigger/touch "
     "trigger/value thumbrest/touch",
     SIM2VR_XY "menu/click", SIM2VR_AB "system/click"},
    {"ml/ml2_controller", "Magic Leap 2 Controller", true,
     SIM2VR_POSES SIM2VR_PAD
     "menu/click home/click trigger/click trigger/value trackpad/force shoulder/click",
     "", ""},
    {"samsung/odyssey_controller", "Odyssey Controller", true,
     SIM2VR_POSES SIM2VR_STICK SIM2VR_PAD "menu/click squeeze/click trigger/value", "", ""},
    {"meta/touch_controller_rift_cv1", "Touch Controller (Rift)", true, SIM2VR_META,
     SIM2VR_XY_TOUCH "menu/click", SIM2VR_AB_TOUCH "system/click"},
    {"meta/touch_controller_quest_1_rift_s", "Touch Controller (Quest)", true, SIM2VR_META,
     SIM2VR_XY_TOUCH "menu/click", SIM2VR_AB_TOUCH "system/click"},
    {"meta/touch_controller_quest_2", "Touch Controller (Quest 2)", true, SIM2VR_META,
     SIM2VR_XY_TOUCH "menu/click", SIM2VR_AB_TOUCH "system/click"},
    {"meta/touch_plus_controller", "Touch Plus Controller", true,
     SIM2VR_META "trigger/force trigger_curl/value trigger_slide/value",
     SIM2VR_XY_TOUCH "menu/click", SIM2VR_AB_TOUCH "system/click"},
    {"meta/touch_pro_controller", "Touch Pro Controller", true,
     SIM2VR_META "thumbrest/force stylus/force trigger_curl/value trigger_slide/value "
                 "output/haptic_trigger output/haptic_thumb",
     SIM2VR_XY_TOUCH "menu/click", SIM2VR_AB_TOUCH "system/click"},
});

/// Profiles of other devices, which nothing here moves.
struct OtherProfile {
  std::string_view path;
  std::string_view name;
  std::string_view user;
  std::string_view paths;
};
constexpr std::array kOtherProfiles = std::to_array<OtherProfile>({
    {"htc/vive_pro", "Vive Pro", "/user/head",
     "system/click volume_up/click volume_down/click mute_mic/click"},
    {"microsoft/xbox_controller", "Xbox Controller", "/user/gamepad",
     "menu/click view/click a/click b/click x/click y/click dpad_down/click dpad_right/click "
     "dpad_up/click dpad_left/click shoulder_left/click shoulder_right/click thumbstick_left "
     "thumbstick_left/x thumbstick_left/y thumbstick_left/click thumbstick_right "
     "thumbstick_right/x thumbstick_right/y thumbstick_right/click trigger_left/value "
     "trigger_right/value output/haptic_left output/haptic_right output/haptic_left_trigger "
     "output/haptic_right_trigger"},
});

struct InputText {
  std::string_view path;
  Input input;
};
constexpr std::array kInputs = std::to_array<InputText>({
    {"grip/pose", Input::grip_pose},
    {"grip_surface/pose", Input::grip_pose},
    {"aim/pose", Input::aim_pose},
    {"output/haptic", Input::haptic},
    {"select/click", Input::trigger},
    {"trigger/value", Input::trigger},
    {"trigger/click", Input::trigger},
    {"trigger/force", Input::trigger},
    {"trigger/touch", Input::trigger_touch},
    {"squeeze/value", Input::squeeze},
    {"squeeze/click", Input::squeeze},
    {"squeeze/force", Input::squeeze},
    {"thumbstick", Input::stick},
    {"thumbstick/x", Input::stick_x},
    {"thumbstick/y", Input::stick_y},
    {"thumbstick/click", Input::stick_click},
    {"thumbstick/touch", Input::stick_touch},
    {"x/click", Input::lower},
    {"a/click", Input::lower},
    {"x/touch", Input::lower_touch},
    {"a/touch", Input::lower_touch},
    {"y/click", Input::upper},
    {"b/click", Input::upper},
    {"y/touch", Input::upper_touch},
    {"b/touch", Input::upper_touch},
    {"menu/click", Input::menu},
    {"thumbrest/touch", Input::thumbrest_touch},
});

InputKind kindOf(std::string_view path) {
  if (path.starts_with("output/")) return InputKind::haptic;
  if (path.ends_with("/pose")) return InputKind::pose;
  if (path.ends_with("/click") || path.ends_with("/touch") || path.ends_with("/proximity")) {
    return InputKind::boolean;
  }
  return path.find('/') == std::string_view::npos ? InputKind::vector : InputKind::number;
}

/// A controller without thumbstick has its stick in the trackpad.
Input inputOf(std::string_view path, bool has_stick) {
  std::string known(path);
  if (!has_stick && path.starts_with("trackpad")) known.replace(0, 8, "thumbstick");
  for (const InputText& each : kInputs) {
    if (each.path == known) return each.input;
  }
  return Input::none;
}

void addPaths(Profile& profile, std::string_view user, std::string_view paths, bool has_stick) {
  while (!paths.empty()) {
    const std::size_t end = std::min(paths.find(' '), paths.size());
    const std::string_view path = paths.substr(0, end);
    paths.remove_prefix(std::min(end + 1, paths.size()));
    if (path.empty()) continue;
    Component component;
    const bool output = path.starts_with("output/");
    component.path = std::string(user) + (output ? "/" : "/input/") + std::string(path);
    component.kind = kindOf(path);
    const bool whole = output || component.kind == InputKind::vector;
    component.source = whole ? component.path : component.path.substr(0, component.path.rfind('/'));
    component.hand = handOf(user);
    if (component.hand) component.input = inputOf(path, has_stick);
    profile.components.push_back(std::move(component));
  }
}

Profile made(const ProfileText& text) {
  Profile profile{
      "/interaction_profiles/" + std::string(text.path), std::string(text.name), text.since_11, {}};
  const bool has_stick = text.both.find("thumbstick") != std::string_view::npos;
  for (const Hand hand : kHands) {
    const bool left = hand == Hand::left;
    const std::string_view user = left ? "/user/hand/left" : "/user/hand/right";
    addPaths(profile, user, text.both, has_stick);
    addPaths(profile, user, left ? text.left : text.right, has_stick);
    addPaths(profile, user, "grip_surface/pose", has_stick);
  }
  return profile;
}

XrVector2f pressed(bool value) { return {value ? 1.0F : 0.0F, 0.0F}; }

XrVector2f valueOf(Input input, const ControllerState& s) {
  switch (input) {
    case Input::trigger:
      return {s.trigger, 0.0F};
    case Input::squeeze:
      return {s.squeeze, 0.0F};
    case Input::stick:
      return s.thumbstick;
    case Input::stick_x:
      return {s.thumbstick.x, 0.0F};
    case Input::stick_y:
      return {s.thumbstick.y, 0.0F};
    case Input::stick_click:
      return pressed(s.thumbstick_click);
    case Input::stick_touch:
      return pressed(s.thumbstick_touch);
    case Input::trigger_touch:
      return pressed(s.trigger_touch);
    case Input::lower:
      return pressed(s.a || s.x);
    case Input::upper:
      return pressed(s.b || s.y);
    case Input::lower_touch:
      return pressed(s.lower_touch);
    case Input::upper_touch:
      return pressed(s.upper_touch);
    case Input::menu:
      return pressed(s.menu);
    case Input::thumbrest_touch:
      return pressed(s.thumbrest_touch);
    default:
      return {0.0F, 0.0F};
  }
}

}  // namespace

std::optional<Hand> handOf(std::string_view path) {
  if (path.starts_with("/user/hand/left")) return Hand::left;
  if (path.starts_with("/user/hand/right")) return Hand::right;
  return std::nullopt;
}

const std::vector<Profile>& profiles() {
  static const std::vector<Profile> all = [] {
    std::vector<Profile> list;
    for (const ProfileText& text : kProfiles) list.push_back(made(text));
    for (const OtherProfile& text : kOtherProfiles) {
      Profile& profile = list.emplace_back();
      profile.path = "/interaction_profiles/" + std::string(text.path);
      profile.localized_name = text.name;
      addPaths(profile, text.user, text.paths, true);
    }
    return list;
  }();
  return all;
}

const Profile* findProfile(std::string_view path) {
  for (const Profile& profile : profiles()) {
    if (profile.path == path) return &profile;
  }
  return nullptr;
}

const Component* Profile::find(std::string_view binding) const {
  for (const char* component : {"", "/value", "/click", "/pose", "/force", "/touch"}) {
    const std::string full = std::string(binding) + component;
    for (const Component& each : components) {
      if (each.path == full) return &each;
    }
  }
  return nullptr;
}

bool fits(InputKind kind, XrActionType type) {
  switch (type) {
    case XR_ACTION_TYPE_BOOLEAN_INPUT:
    case XR_ACTION_TYPE_FLOAT_INPUT:
      return kind == InputKind::boolean || kind == InputKind::number;
    case XR_ACTION_TYPE_VECTOR2F_INPUT:
      return kind == InputKind::vector;
    case XR_ACTION_TYPE_POSE_INPUT:
      return kind == InputKind::pose;
    case XR_ACTION_TYPE_VIBRATION_OUTPUT:
      return kind == InputKind::haptic;
    default:
      return false;
  }
}

XrVector2f readInput(const Component& component, XrActionType type, const ControllerState& hand) {
  const XrVector2f value = valueOf(component.input, hand);
  const bool digital = type == XR_ACTION_TYPE_BOOLEAN_INPUT || component.kind == InputKind::boolean;
  return digital ? pressed(value.x >= kPressed) : value;
}

}  // namespace sim2vr::xr

#include "input_paths.hpp"

#include "sim2vr/xr/action.hpp"

namespace sim2vr::xr {
namespace {

using State = ControllerState;

XrVector2f asValue(bool pressed) { return {pressed ? 1.0F : 0.0F, 0.0F}; }
XrVector2f noValue(const State&) { return {0.0F, 0.0F}; }

void addHand(std::vector<InputPath>& paths, Hand hand) {
  const std::string user = hand == Hand::left ? "/user/hand/left/" : "/user/hand/right/";
  const auto add = [&](const char* tail, InputKind kind, XrVector2f (*read)(const State&)) {
    paths.push_back({user + tail, hand, kind, read});
  };
  add("input/grip/pose", InputKind::grip_pose, noValue);
  add("input/aim/pose", InputKind::aim_pose, noValue);
  add("input/trigger/value", InputKind::analogue,
      [](const State& s) { return XrVector2f{s.trigger, 0}; });
  add("input/squeeze/value", InputKind::analogue,
      [](const State& s) { return XrVector2f{s.squeeze, 0}; });
  add("input/thumbstick", InputKind::stick, [](const State& s) { return s.thumbstick; });
  add("input/thumbstick/x", InputKind::analogue,
      [](const State& s) { return XrVector2f{s.thumbstick.x, 0}; });
  add("input/thumbstick/y", InputKind::analogue,
      [](const State& s) { return XrVector2f{s.thumbstick.y, 0}; });
  add("input/thumbstick/click", InputKind::button,
      [](const State& s) { return asValue(s.thumbstick_click); });
  add("input/thumbstick/touch", InputKind::button,
      [](const State& s) { return asValue(s.thumbstick_touch); });
  add("input/trigger/touch", InputKind::button,
      [](const State& s) { return asValue(s.trigger_touch); });
  add("input/thumbrest/touch", InputKind::button,
      [](const State& s) { return asValue(s.thumbrest_touch); });
  const auto lower_touch = [](const State& s) { return asValue(s.lower_touch); };
  const auto upper_touch = [](const State& s) { return asValue(s.upper_touch); };
  if (hand == Hand::left) {
    add("input/x/click", InputKind::button, [](const State& s) { return asValue(s.x); });
    add("input/y/click", InputKind::button, [](const State& s) { return asValue(s.y); });
    add("input/menu/click", InputKind::button, [](const State& s) { return asValue(s.menu); });
    add("input/x/touch", InputKind::button, lower_touch);
    add("input/y/touch", InputKind::button, upper_touch);
  } else {
    add("input/a/click", InputKind::button, [](const State& s) { return asValue(s.a); });
    add("input/b/click", InputKind::button, [](const State& s) { return asValue(s.b); });
    add("input/a/touch", InputKind::button, lower_touch);
    add("input/b/touch", InputKind::button, upper_touch);
  }
  add("output/haptic", InputKind::haptic, noValue);
}

const std::vector<InputPath>& allPaths() {
  static const std::vector<InputPath> paths = [] {
    std::vector<InputPath> list;
    for (const Hand hand : kHands) addHand(list, hand);
    return list;
  }();
  return paths;
}

}  // namespace

bool InputPath::fits(XrActionType type) const {
  switch (type) {
    case XR_ACTION_TYPE_BOOLEAN_INPUT:
    case XR_ACTION_TYPE_FLOAT_INPUT:
      return kind == InputKind::button || kind == InputKind::analogue;
    case XR_ACTION_TYPE_VECTOR2F_INPUT:
      return kind == InputKind::stick;
    case XR_ACTION_TYPE_POSE_INPUT:
      return kind == InputKind::grip_pose || kind == InputKind::aim_pose;
    case XR_ACTION_TYPE_VIBRATION_OUTPUT:
      return kind == InputKind::haptic;
    default:
      return false;
  }
}

const InputPath* findInputPath(std::string_view path) {
  for (const char* component : {"", "/value", "/click", "/pose"}) {
    const std::string full = std::string(path) + component;
    for (const InputPath& known : allPaths()) {
      if (known.path == full) return &known;
    }
  }
  return nullptr;
}

const std::vector<std::string>& knownBindingPaths() {
  static const std::vector<std::string> paths = [] {
    std::vector<std::string> list;
    for (const InputPath& known : allPaths()) list.push_back(known.path);
    return list;
  }();
  return paths;
}

}  // namespace sim2vr::xr

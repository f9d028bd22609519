// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/xr/session.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::xr {
namespace {

/// What the simulated controllers have.
const Profile& touchProfile() {
  static const Profile& profile = *findProfile("/interaction_profiles/oculus/touch_controller");
  return profile;
}

std::vector<std::string> knownPaths() {
  std::vector<std::string> paths;
  for (const Component& component : touchProfile().components) {
    if (component.input != Input::none) paths.push_back(component.path);
  }
  return paths;
}

std::string inQuotes(std::string_view text) { return "'" + std::string(text) + "'"; }

void requireName(const char* what, const std::string& name, bool used) {
  if (!isName(name) || name.size() >= XR_MAX_ACTION_NAME_SIZE) {
    throw InvalidArgument(what, inQuotes(name), "1 to 63 characters out of a-z 0-9 - _ .");
  }
  if (used) throw InvalidArgument(what, inQuotes(name) + " twice", "a name not used before");
}

}  // namespace

void SessionSettings::validate() const {
  if (!(ipd_m >= 0.0F && ipd_m <= 0.2F)) {
    throw InvalidArgument("ipd_m", std::to_string(ipd_m), "metres from 0 to 0.2");
  }
  if (!(vertical_fov_deg > 0.0F && vertical_fov_deg < 180.0F)) {
    throw InvalidArgument("vertical_fov_deg", std::to_string(vertical_fov_deg),
                          "degrees above 0 and below 180");
  }
  if (!(aspect > 0.0F && std::isfinite(aspect))) {
    throw InvalidArgument("aspect", std::to_string(aspect), "width / height above 0");
  }
}

Session::Session(const SessionSettings& settings) : settings_(settings) { settings_.validate(); }

void Session::nextFrame(XrTime time, const DeviceState& devices) {
  if (!attached_) {
    throw StateError("nextFrame: no action sets are attached; call attachActionSets first");
  }
  tracking_.track({time, devices});
  syncActions(attached_actions_, active_sets_, &tracking_.latest()->devices, time);
}

XrTime Session::frameTime() const {
  const Frame* frame = tracking_.latest();
  return frame == nullptr ? 0 : frame->time;
}

void Session::requireNotAttached(const char* call) const {
  if (!attached_) return;
  throw StateError(std::string(call) +
                   ": the action sets are attached already; that is possible once per session");
}

ActionSet& Session::createActionSet(const std::string& name) {
  requireNotAttached("createActionSet");
  requireName("action set name", name,
              std::any_of(action_sets_.begin(), action_sets_.end(),
                          [&](const ActionSet& set) { return set.name == name; }));
  ActionSet& set = action_sets_.emplace_back();
  set.name = name;
  return set;
}

Action& Session::createAction(const ActionSet& set, const std::string& name, XrActionType type,
                              const std::vector<Hand>& hands) {
  requireNotAttached("createAction");
  requireName("action name", name, findAction(set.name, name) != nullptr);
  if (typeName(type) == nullptr) {
    throw InvalidArgument("action '" + name + "' type", std::to_string(type),
                          "boolean, float, vector2f or pose input, or vibration output");
  }
  Action& action = actions_.emplace_back();
  action.name = name;
  action.type = type;
  action.set = &set;
  if (!hands.empty()) action.hands = {};
  for (const Hand hand : hands) action.hands[static_cast<std::size_t>(hand)] = true;
  return action;
}

const Action* Session::findAction(std::string_view set, std::string_view name) const {
  const auto found = std::find_if(actions_.begin(), actions_.end(), [&](const Action& action) {
    return action.set->name == set && action.name == name;
  });
  return found == actions_.end() ? nullptr : &*found;
}

void Session::suggestBinding(Action& action, std::string_view path) {
  requireNotAttached("suggestBinding");
  const Component* component = touchProfile().find(path);
  if (component == nullptr || component->input == Input::none) {
    throw InvalidArgument(
        "binding path", inQuotes(path),
        "an input or output of the Touch controllers" + didYouMean(path, knownPaths()));
  }
  if (!action.bind(*component)) {
    throw InvalidArgument("binding path", inQuotes(path),
                          std::string("a path for the ") + typeName(action.type) + " action '" +
                              action.name + "' and of a hand that it was created with");
  }
}

void Session::attachActionSets() {
  requireNotAttached("attachActionSets");
  attached_ = true;
  for (Action& action : actions_) attached_actions_.push_back(&action);
  for (const ActionSet& set : action_sets_) active_sets_.push_back({&set});
}

void Session::applyHapticFeedback(const Action& action, std::optional<Hand> hand,
                                  const XrHapticVibration& vibration) {
  if (action.type != XR_ACTION_TYPE_VIBRATION_OUTPUT) {
    throw InvalidArgument("action " + inQuotes(action.name), typeName(action.type),
                          "a vibration output");
  }
  if (!isVibration(vibration)) {
    throw InvalidArgument("vibration",
                          "amplitude " + std::to_string(vibration.amplitude) + ", frequency " +
                              std::to_string(vibration.frequency) + ", duration " +
                              std::to_string(vibration.duration),
                          "0 to 1, 0 Hz or more, and 0 ns or more or XR_MIN_HAPTIC_DURATION");
  }
  for (const Component* output : action.bindings) {
    if ((hand && output->hand != hand) || !action.state(*output->hand).active) continue;
    pulses_.push_back(
        {*output->hand, vibration.amplitude, vibration.frequency, vibration.duration});
  }
}

std::vector<HapticPulse> Session::takePulses() { return std::exchange(pulses_, {}); }

Space Session::actionSpace(const Action& action, Hand hand) const {
  const auto index = static_cast<std::size_t>(hand);
  if (action.type != XR_ACTION_TYPE_POSE_INPUT || !action.hands[index]) {
    throw InvalidArgument("action " + inQuotes(action.name), "a request for an action space",
                          "a pose action that was created with this hand");
  }
  return {.action = &action, .hand = index};
}

std::optional<XrPosef> Session::locateSpace(const Space& space) const {
  const std::optional<Motion> found = tracking_.locate(space, frameTime());
  if (!found) return std::nullopt;
  return found->pose;
}

std::array<XrView, 2> Session::locateViews() const {
  const Space head{.reference = XR_REFERENCE_SPACE_TYPE_VIEW};
  std::array<XrView, 2> views;
  for (std::size_t eye = 0; eye < views.size(); ++eye) {
    const auto found = tracking_.locate(eyeSpace(eye, settings_.ipd_m), head, frameTime());
    views[eye] = {XR_TYPE_VIEW, nullptr, found->pose,
                  eyeFov(settings_.vertical_fov_deg, settings_.aspect)};
  }
  return views;
}

void Session::fields(Archive& archive) {
  std::uint64_t count = actions_.size();
  archive.field("actions", count);
  if (count != actions_.size()) {
    throw EngineError("saved state: it has " + std::to_string(count) +
                      " actions, this session has " + std::to_string(actions_.size()));
  }
  for (Action& action : actions_) action.fields(archive);
  archive.field("tracking", tracking_);
}

}  // namespace sim2vr::xr

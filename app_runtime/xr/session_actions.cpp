// Session: actions and haptics.
#include <algorithm>
#include <cmath>

#include "input_paths.hpp"
#include "names.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::xr {
namespace {

std::string quoted(const Action& action) { return "action '" + action.name() + "'"; }

XrBool32 toXrBool(bool value) { return value ? XR_TRUE : XR_FALSE; }

void requireVibration(const XrHapticVibration& vibration) {
  if (!(vibration.amplitude >= 0.0F && vibration.amplitude <= 1.0F)) {
    throw InvalidArgument("vibration.amplitude", std::to_string(vibration.amplitude),
                          "a number from 0 to 1");
  }
  if (!(vibration.frequency >= 0.0F && std::isfinite(vibration.frequency))) {
    throw InvalidArgument("vibration.frequency", std::to_string(vibration.frequency),
                          "Hz, 0 (XR_FREQUENCY_UNSPECIFIED) or more");
  }
  if (vibration.duration <= 0 && vibration.duration != XR_MIN_HAPTIC_DURATION) {
    throw InvalidArgument("vibration.duration", std::to_string(vibration.duration),
                          "ns above 0, or XR_MIN_HAPTIC_DURATION");
  }
}

}  // namespace

void Session::requireNotAttached(const char* call) const {
  if (!attached_) return;
  throw StateError(std::string(call) +
                   ": the action sets are attached already; that is possible once per session");
}

ActionSet& Session::createActionSet(const std::string& name) {
  requireNotAttached("createActionSet");
  requireName("action set name", name);
  if (findActionSet(name) != nullptr) {
    throw InvalidArgument("action set name", "'" + name + "' twice", "a name not used before");
  }
  action_sets_.push_back(std::unique_ptr<ActionSet>(new ActionSet(name)));
  return *action_sets_.back();
}

ActionSet* Session::findActionSet(std::string_view name) const {
  for (const auto& set : action_sets_) {
    if (set->name() == name) return set.get();
  }
  return nullptr;
}

void Session::suggestBinding(Action& action, std::string_view path) {
  requireNotAttached("suggestBinding");
  const std::string got = quote(path);
  const InputPath* input = findInputPath(path);
  if (input == nullptr) {
    throw InvalidArgument(
        "binding path", got,
        "an input or output of the Touch controllers" + didYouMean(path, knownBindingPaths()));
  }
  if (!input->fits(action.type())) {
    throw InvalidArgument(
        "binding path", got,
        std::string("a path for the ") + typeName(action.type()) + " " + quoted(action));
  }
  if (!action.subactionHands().empty() && !action.hasHand(input->hand)) {
    throw InvalidArgument("binding path", got,
                          "a path of a hand that " + quoted(action) + " was created with");
  }
  auto& bindings = action.bindings_;
  if (std::find(bindings.begin(), bindings.end(), input) == bindings.end()) {
    bindings.push_back(input);
  }
}

void Session::attachActionSets() {
  requireNotAttached("attachActionSets");
  attached_ = true;
  for (const auto& set : action_sets_) set->attached_ = true;
}

XrResult Session::syncActions() {
  requireRunning("syncActions");
  if (!attached_) {
    throw StateError("syncActions: no action sets are attached; call attachActionSets first");
  }
  const bool focused = state_ == XR_SESSION_STATE_FOCUSED;
  if (focused) {
    sampled_ = false;
    sampleFrame();
  }
  for (const auto& set : action_sets_) {
    for (const auto& action : set->actions()) {
      action->sync(focused ? &sample_ : nullptr, frame_time_);
    }
  }
  return focused ? XR_SUCCESS : XR_SESSION_NOT_FOCUSED;
}

void Session::requireAction(const Action& action, XrActionType type,
                            std::optional<Hand> hand) const {
  if (!attached_) {
    throw StateError(quoted(action) +
                     ": its set is not attached to the session; call attachActionSets first");
  }
  if (action.type() != type) {
    throw InvalidArgument(quoted(action), std::string("a call for a ") + typeName(type) + " action",
                          std::string("one for its own type, ") + typeName(action.type()));
  }
  if (hand && !action.hasHand(*hand)) {
    throw InvalidArgument(quoted(action), std::string("the ") + handName(*hand) + " hand",
                          "a hand that the action was created with");
  }
}

const ActionState& Session::actionState(const Action& action, XrActionType type,
                                        std::optional<Hand> hand) const {
  requireAction(action, type, hand);
  return hand ? action.perHand(*hand) : action.combined_;
}

XrActionStateBoolean Session::getActionStateBoolean(const Action& action,
                                                    std::optional<Hand> hand) const {
  const ActionState& state = actionState(action, XR_ACTION_TYPE_BOOLEAN_INPUT, hand);
  return {XR_TYPE_ACTION_STATE_BOOLEAN, nullptr,           toXrBool(state.value.x != 0.0F),
          toXrBool(state.changed),      state.last_change, toXrBool(state.active)};
}

XrActionStateFloat Session::getActionStateFloat(const Action& action,
                                                std::optional<Hand> hand) const {
  const ActionState& state = actionState(action, XR_ACTION_TYPE_FLOAT_INPUT, hand);
  return {XR_TYPE_ACTION_STATE_FLOAT, nullptr,           state.value.x,
          toXrBool(state.changed),    state.last_change, toXrBool(state.active)};
}

XrActionStateVector2f Session::getActionStateVector2f(const Action& action,
                                                      std::optional<Hand> hand) const {
  const ActionState& state = actionState(action, XR_ACTION_TYPE_VECTOR2F_INPUT, hand);
  return {XR_TYPE_ACTION_STATE_VECTOR2F, nullptr,           state.value,
          toXrBool(state.changed),       state.last_change, toXrBool(state.active)};
}

XrActionStatePose Session::getActionStatePose(const Action& action,
                                              std::optional<Hand> hand) const {
  const ActionState& state = actionState(action, XR_ACTION_TYPE_POSE_INPUT, hand);
  return {XR_TYPE_ACTION_STATE_POSE, nullptr, toXrBool(state.active)};
}

XrResult Session::applyHapticFeedback(const Action& action, std::optional<Hand> hand,
                                      const XrHapticVibration& vibration) {
  requireAction(action, XR_ACTION_TYPE_VIBRATION_OUTPUT, hand);
  requireVibration(vibration);
  if (state_ != XR_SESSION_STATE_FOCUSED) return XR_SESSION_NOT_FOCUSED;
  for (const InputPath* output : action.bindings_) {
    if (hand && output->hand != *hand) continue;
    if (action.perHand(output->hand).active) device_.haptic(output->hand, vibration);
  }
  return XR_SUCCESS;
}

XrResult Session::stopHapticFeedback(const Action& action, std::optional<Hand> hand) {
  const XrHapticVibration silence{XR_TYPE_HAPTIC_VIBRATION, nullptr, XR_MIN_HAPTIC_DURATION,
                                  XR_FREQUENCY_UNSPECIFIED, 0.0F};
  return applyHapticFeedback(action, hand, silence);
}

void Session::fieldsOfActions(Archive& archive) {
  std::uint64_t count = 0;
  for (const auto& set : action_sets_) count += set->actions().size();
  std::uint64_t saved_count = count;
  archive.field("actions", saved_count);
  if (saved_count != count) {
    throw EngineError("saved state: it has " + std::to_string(saved_count) +
                      " actions, this session has " + std::to_string(count));
  }
  for (const auto& set : action_sets_) {
    for (const auto& action : set->actions()) action->fields(archive);
  }
}

}  // namespace sim2vr::xr

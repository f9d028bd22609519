#include "sim2vr/xr/action.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "input_paths.hpp"
#include "names.hpp"
#include "sim2vr/core/errors.hpp"
#include "xr_archive.hpp"

namespace sim2vr::xr {
namespace {

// An analogue input presses a boolean action from its middle on.
constexpr float kPressThreshold = 0.5F;

float length(const XrVector2f& v) { return std::hypot(v.x, v.y); }

XrVector2f readAs(XrActionType type, const InputPath& input, const ControllerState& controller) {
  const XrVector2f value = input.read(controller);
  if (type != XR_ACTION_TYPE_BOOLEAN_INPUT) return value;
  return {value.x >= kPressThreshold ? 1.0F : 0.0F, 0.0F};
}

void put(ActionState& state, bool active, XrVector2f value, XrTime time) {
  if (!active) {
    state = {};
    return;
  }
  state.active = true;
  state.changed = value.x != state.value.x || value.y != state.value.y;
  if (state.changed) state.last_change = time;
  state.value = value;
}

}  // namespace

void requireName(const char* what, const std::string& name) {
  const bool valid =
      !name.empty() && name.size() <= 63 && std::all_of(name.begin(), name.end(), [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '_' || c == '.';
      });
  if (!valid) {
    throw InvalidArgument(what, "'" + name + "'", "1 to 63 characters out of a-z 0-9 - _ .");
  }
}

void ActionState::fields(Archive& archive) {
  vectorField(archive, "value", value);
  archive.field("changed", changed);
  archive.field("active", active);
  archive.field("last_change", last_change);
}

Action::Action(std::string name, XrActionType type, std::vector<Hand> hands)
    : name_(std::move(name)), type_(type), hands_(std::move(hands)) {}

bool Action::hasHand(Hand hand) const {
  return std::find(hands_.begin(), hands_.end(), hand) != hands_.end();
}

// `state` is null while no input is delivered.
void Action::sync(const DeviceState* state, XrTime time) {
  struct Reading {
    bool active = false;
    XrVector2f value{0.0F, 0.0F};

    void add(XrVector2f other) {
      active = true;
      if (length(other) > length(value)) value = other;
    }
  };
  std::array<Reading, 2> hands;
  Reading all;
  for (const InputPath* input : bindings_) {
    if (state == nullptr || !state->hand(input->hand).active) continue;
    const XrVector2f value = readAs(type_, *input, state->hand(input->hand));
    hands[static_cast<std::size_t>(input->hand)].add(value);
    all.add(value);
  }
  for (const Hand hand : kHands) {
    const Reading& reading = hands[static_cast<std::size_t>(hand)];
    put(perHand(hand), reading.active, reading.value, time);
  }
  put(combined_, all.active, all.value, time);
}

void Action::fields(Archive& archive) {
  std::string name = name_;
  archive.field("action", name);
  if (name != name_) {
    throw EngineError("saved state: action '" + name + "' where this session has '" + name_ + "'");
  }
  archive.field("per_hand", per_hand_);
  archive.field("combined", combined_);
}

Action& ActionSet::createAction(const std::string& name, XrActionType type,
                                std::vector<Hand> subactions) {
  if (attached_) {
    throw StateError("createAction('" + name + "'): action set '" + name_ +
                     "' is attached already; create all actions before attachActionSets");
  }
  requireName("action name", name);
  if (findAction(name) != nullptr) {
    throw InvalidArgument("action name", "'" + name + "' twice",
                          "a name not used before in the action set '" + name_ + "'");
  }
  if (type != XR_ACTION_TYPE_BOOLEAN_INPUT && type != XR_ACTION_TYPE_FLOAT_INPUT &&
      type != XR_ACTION_TYPE_VECTOR2F_INPUT && type != XR_ACTION_TYPE_POSE_INPUT &&
      type != XR_ACTION_TYPE_VIBRATION_OUTPUT) {
    throw InvalidArgument("action '" + name + "' type", std::to_string(type),
                          "boolean, float, vector2f or pose input, or vibration output");
  }
  actions_.push_back(std::unique_ptr<Action>(new Action(name, type, std::move(subactions))));
  return *actions_.back();
}

Action* ActionSet::findAction(std::string_view name) const {
  for (const auto& action : actions_) {
    if (action->name() == name) return action.get();
  }
  return nullptr;
}

}  // namespace sim2vr::xr

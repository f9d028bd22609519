// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/xr/action.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "sim2vr/core/errors.hpp"
#include "xr_archive.hpp"

namespace sim2vr::xr {
namespace {

float magnitude(const XrVector2f& v) { return std::hypot(v.x, v.y); }

/// Several inputs of one action: the one that is furthest from rest.
void merge(ActionState& into, const XrVector2f& value) {
  if (magnitude(value) > magnitude(into.value)) into.value = value;
  into.active = true;
}

void store(ActionState& stored, const ActionState& fresh, XrTime time) {
  if (!fresh.active) {
    stored = {};
    return;
  }
  // Before it became active it was 0.
  stored.changed = fresh.value.x != stored.value.x || fresh.value.y != stored.value.y;
  if (stored.changed) stored.last_change = time;
  stored.value = fresh.value;
  stored.active = true;
}

bool wants(std::span<const ActiveSet> active, const Action& action, Hand hand) {
  return std::any_of(active.begin(), active.end(), [&](const ActiveSet& each) {
    return each.set == action.set && each.hands[static_cast<std::size_t>(hand)];
  });
}

using Priorities = std::map<std::string_view, std::uint32_t>;

/// The highest priority of an active set by input source. Empty where all have the same.
Priorities sourcePriorities(std::span<Action* const> actions, std::span<const ActiveSet> active) {
  Priorities priorities;
  const bool same = std::all_of(active.begin(), active.end(), [&](const ActiveSet& each) {
    return each.set->priority == active.front().set->priority;
  });
  if (same) return priorities;
  for (const Action* action : actions) {
    for (const Component* component : action->bindings) {
      if (!wants(active, *action, *component->hand)) continue;
      std::uint32_t& highest = priorities[component->source];
      highest = std::max(highest, action->set->priority);
    }
  }
  return priorities;
}

}  // namespace

void ActionState::fields(Archive& archive) {
  vectorField(archive, "value", value);
  archive.field("changed", changed);
  archive.field("active", active);
  archive.field("last_change", last_change);
}

bool Action::bind(const Component& component) {
  if (!component.hand || !hands[static_cast<std::size_t>(*component.hand)] ||
      component.input == Input::none || !fits(component.kind, type)) {
    return false;
  }
  if (std::find(bindings.begin(), bindings.end(), &component) == bindings.end()) {
    bindings.push_back(&component);
  }
  return true;
}

void Action::fields(Archive& archive) {
  std::string saved = name;
  archive.field("action", saved);
  if (saved != name) {
    throw EngineError("saved state: action '" + saved + "' where this session has '" + name + "'");
  }
  archive.field("states", states);
}

void syncActions(std::span<Action* const> actions, std::span<const ActiveSet> active,
                 const DeviceState* devices, XrTime time) {
  const Priorities priorities = sourcePriorities(actions, active);
  for (Action* action : actions) {
    std::array<ActionState, 4> fresh;
    for (const Component* component : action->bindings) {
      const Hand hand = *component->hand;
      if (devices == nullptr || !devices->hand(hand).active) continue;
      if (!wants(active, *action, hand)) continue;
      const auto highest = priorities.find(component->source);
      if (highest != priorities.end() && highest->second > action->set->priority) continue;
      const XrVector2f value = readInput(*component, action->type, devices->hand(hand));
      merge(fresh[static_cast<std::size_t>(hand)], value);
      merge(fresh[kBothHands], value);
    }
    for (std::size_t i = 0; i < fresh.size(); ++i) store(action->states[i], fresh[i], time);
  }
}

bool isName(std::string_view text) {
  return text.find_first_not_of('.') != std::string_view::npos &&
         std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '_' ||
                  c == '.';
         });
}

const char* typeName(XrActionType type) {
  switch (type) {
    case XR_ACTION_TYPE_BOOLEAN_INPUT:
      return "boolean";
    case XR_ACTION_TYPE_FLOAT_INPUT:
      return "float";
    case XR_ACTION_TYPE_VECTOR2F_INPUT:
      return "vector2f";
    case XR_ACTION_TYPE_POSE_INPUT:
      return "pose";
    case XR_ACTION_TYPE_VIBRATION_OUTPUT:
      return "vibration";
    default:
      return nullptr;
  }
}

bool isVibration(const XrHapticVibration& vibration) {
  return vibration.amplitude >= 0.0F && vibration.amplitude <= 1.0F &&
         std::isfinite(vibration.frequency) && vibration.frequency >= 0.0F &&
         vibration.duration >= XR_MIN_HAPTIC_DURATION;
}

}  // namespace sim2vr::xr

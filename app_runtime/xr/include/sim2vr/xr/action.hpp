// SPDX-License-Identifier: Apache-2.0
// Actions: what an app wants to know ("grab"), apart from the button that says it.
#pragma once

#include <openxr/openxr.h>

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/xr/device.hpp"
#include "sim2vr/xr/profiles.hpp"

namespace sim2vr::xr {

/// A named group of actions that get input together.
struct ActionSet {
  std::string name;
  std::uint32_t priority = 0;
  bool attached = false;  // to a session: it cannot change any more
};

/// An action's value as of the latest sync. An inactive one is 0.
struct ActionState {
  XrVector2f value{0.0F, 0.0F};  // boolean and float: x
  bool changed = false;
  bool active = false;
  XrTime last_change = 0;

  bool pressed() const { return value.x > 0.0F; }
  void fields(Archive& archive);
};

/// Indices into Action::states after the two hands'.
inline constexpr std::size_t kBothHands = 2;
inline constexpr std::size_t kOtherDevice = 3;

struct Action {
  std::string name;
  XrActionType type = XR_ACTION_TYPE_BOOLEAN_INPUT;
  const ActionSet* set = nullptr;
  std::array<bool, 2> hands{true, true};  // whose inputs and outputs it can be bound to
  std::vector<const Component*> bindings;
  /// By hand; of both together (boolean: or; float and vector: the value furthest from 0); of
  /// another device, never active.
  std::array<ActionState, 4> states;

  /// Binds it, once. False: an input of another kind or hand, or none of the simulated controllers.
  bool bind(const Component& component);
  const ActionState& state(Hand hand) const { return states[static_cast<std::size_t>(hand)]; }
  void fields(Archive& archive);
};

/// An action set that gets input in a sync, of one hand or of both.
struct ActiveSet {
  const ActionSet* set;
  std::array<bool, 2> hands{true, true};
};

/// Updates the states of the attached actions. Of active sets that are bound to the same input
/// those with the highest priority get it. `devices`: null while nothing is tracked.
void syncActions(std::span<Action* const> actions, std::span<const ActiveSet> active,
                 const DeviceState* devices, XrTime time);

/// Whether actions and action sets may be called so: characters a-z 0-9 - _ . and not only dots.
bool isName(std::string_view text);
/// Such as "float"; null: no type of action.
const char* typeName(XrActionType type);
bool isVibration(const XrHapticVibration& vibration);

}  // namespace sim2vr::xr

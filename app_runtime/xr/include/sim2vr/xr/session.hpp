// SPDX-License-Identifier: Apache-2.0
// A session of one of our own games: OpenXR's actions and spaces as C++ classes on Khronos' own
// types, in lockstep. It is focused from its first frame on, and there is no time but the one
// passed to nextFrame. Wrong use that OpenXR reports as an error code is a StateError (wrong order)
// or an InvalidArgument (wrong value) here.
#pragma once

#include <openxr/openxr.h>

#include <array>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/xr/action.hpp"
#include "sim2vr/xr/tracking.hpp"

namespace sim2vr::xr {

struct SessionSettings {
  float ipd_m = 0.064F;            // distance between the eyes
  float vertical_fov_deg = 90.0F;  // full angle, symmetric
  float aspect = 1.5F;             // width / height of an eye's image

  /// Throws InvalidArgument naming the value that is out of range.
  void validate() const;
};

class Session {
 public:
  explicit Session(const SessionSettings& settings = {});
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  const SessionSettings& settings() const { return settings_; }

  /// A frame that is displayed at `time` (ns): all that the session says is of these devices until
  /// the next one. They are validated() ones. Throws StateError before attachActionSets.
  void nextFrame(XrTime time, const DeviceState& devices);
  /// Time of the latest frame; 0 before the first.
  XrTime frameTime() const;

  // --- Actions (action.hpp).

  /// Throws StateError after attachActionSets, InvalidArgument for a name used before or not of the
  /// characters a-z 0-9 - _ .
  ActionSet& createActionSet(const std::string& name);
  /// `hands`: those whose inputs and outputs it can be bound to; empty: both. Throws as
  /// createActionSet does.
  Action& createAction(const ActionSet& set, const std::string& name, XrActionType type,
                       const std::vector<Hand>& hands = {});
  /// Null: there is none.
  const Action* findAction(std::string_view set, std::string_view name) const;
  /// Binds an action to an input or output such as "/user/hand/right/input/trigger/value". Throws
  /// StateError after attachActionSets; InvalidArgument for an unknown path (with the nearest known
  /// one) and for one that does not fit the action's type and hands.
  void suggestBinding(Action& action, std::string_view path);
  /// Fixes all action sets and bindings. Throws StateError the second time.
  void attachActionSets();
  bool attached() const { return attached_; }

  /// The state of a hand, or of both together.
  const ActionState& actionState(const Action& action,
                                 std::optional<Hand> hand = std::nullopt) const {
    return action.states[hand ? static_cast<std::size_t>(*hand) : kBothHands];
  }
  /// Vibrates the controllers that the action is bound to and that are tracked. Throws
  /// InvalidArgument for an action of another type, and for a vibration outside its range.
  void applyHapticFeedback(const Action& action, std::optional<Hand> hand,
                           const XrHapticVibration& vibration);
  /// The vibrations since the last call, in order. Not part of saved states.
  std::vector<HapticPulse> takePulses();

  // --- Spaces (tracking.hpp).

  /// Throws InvalidArgument unless `action` is a pose action with this hand.
  Space actionSpace(const Action& action, Hand hand) const;
  /// The pose of `space` in STAGE in the latest frame; nothing: an action space that is inactive.
  std::optional<XrPosef> locateSpace(const Space& space) const;
  /// The left and the right eye in VIEW.
  std::array<XrView, 2> locateViews() const;

  /// Loading needs the same actions and bindings; it throws EngineError otherwise.
  void fields(Archive& archive);

 private:
  void requireNotAttached(const char* call) const;

  SessionSettings settings_;
  std::deque<ActionSet> action_sets_;
  std::deque<Action> actions_;
  bool attached_ = false;
  std::vector<Action*> attached_actions_;
  std::vector<ActiveSet> active_sets_;
  Tracking tracking_{1};
  std::vector<HapticPulse> pulses_;
};

}  // namespace sim2vr::xr

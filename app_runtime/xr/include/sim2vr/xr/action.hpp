// Actions: what the app wants to know ("grab"), apart from the button that tells it.
#pragma once

#include <openxr/openxr.h>

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::xr {

class Session;
struct InputPath;

/// One action's value for one hand, or for all its hands, as of the latest sync.
struct ActionState {
  XrVector2f value{0.0F, 0.0F};  // boolean and float: x
  bool changed = false;
  bool active = false;
  XrTime last_change = 0;

  void fields(Archive& archive);
};

/// Made by ActionSet::createAction; read through the Session.
class Action {
 public:
  const std::string& name() const { return name_; }
  XrActionType type() const { return type_; }
  /// The hands it was created with; empty: it is not told apart by hand.
  const std::vector<Hand>& subactionHands() const { return hands_; }
  bool hasHand(Hand hand) const;

 private:
  friend class ActionSet;
  friend class Session;

  Action(std::string name, XrActionType type, std::vector<Hand> hands);
  void sync(const DeviceState* state, XrTime time);
  ActionState& perHand(Hand hand) { return per_hand_[static_cast<std::size_t>(hand)]; }
  const ActionState& perHand(Hand hand) const { return per_hand_[static_cast<std::size_t>(hand)]; }
  void fields(Archive& archive);

  std::string name_;
  XrActionType type_;
  std::vector<Hand> hands_;
  std::vector<const InputPath*> bindings_;
  std::array<ActionState, 2> per_hand_;
  ActionState combined_;
};

/// A named group of actions, made by Session::createActionSet.
class ActionSet {
 public:
  const std::string& name() const { return name_; }
  /// `subactions`: the hands to tell apart. Types: boolean, float and vector2f input, pose input,
  /// vibration output. Throws StateError once the set is attached, InvalidArgument for a name used
  /// before or not of the characters a-z 0-9 - _ . or for another type.
  Action& createAction(const std::string& name, XrActionType type,
                       std::vector<Hand> subactions = {});
  Action* findAction(std::string_view name) const;
  const std::vector<std::unique_ptr<Action>>& actions() const { return actions_; }

 private:
  friend class Session;
  explicit ActionSet(std::string name) : name_(std::move(name)) {}

  std::string name_;
  std::vector<std::unique_ptr<Action>> actions_;
  bool attached_ = false;
};

/// The input and output paths that suggestBinding knows, both hands.
const std::vector<std::string>& knownBindingPaths();

}  // namespace sim2vr::xr

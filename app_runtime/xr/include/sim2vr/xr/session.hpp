// An OpenXR session in lockstep: the same states, frame loop, spaces and actions as the
// specification's, as C++ classes on Khronos' own types. There is no runtime behind it but a
// Device, and no time but the one passed to waitFrame. Wrong use that OpenXR reports as an error
// code is a StateError (wrong order) or an InvalidArgument (wrong value) here.
#pragma once

#include <openxr/openxr.h>

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/xr/action.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::xr {

struct SessionSettings {
  float ipd_m = 0.064F;            // distance between the eyes
  float vertical_fov_deg = 90.0F;  // full angle, symmetric
  float aspect = 1.5F;             // width / height of an eye's image

  /// Throws InvalidArgument naming the value that is out of range.
  void validate() const;
};

/// A place that can be located: a reference space or an action space, with a fixed offset.
struct Space {
  XrReferenceSpaceType reference = XR_REFERENCE_SPACE_TYPE_STAGE;
  const Action* action = nullptr;  // not null: an action space
  Hand hand = Hand::left;
  XrPosef offset = kIdentityPose;  // pose of this space in its reference or action space
};

class Session {
 public:
  /// A session that is READY to begin. `device` must outlive it.
  explicit Session(Device& device, const SessionSettings& settings = {});
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  const SessionSettings& settings() const { return settings_; }
  Device& device() const { return device_; }

  // --- Life cycle. IDLE -> READY -> begin() -> SYNCHRONIZED -> first waitFrame() -> VISIBLE ->
  // FOCUSED
  //     -> requestExit() -> VISIBLE -> SYNCHRONIZED -> STOPPING -> end() -> IDLE -> EXITING.

  XrSessionState state() const { return state_; }
  /// Between begin() and end().
  bool isRunning() const;
  /// Oldest state change not reported yet.
  std::optional<XrEventDataSessionStateChanged> pollEvent();

  /// Throws StateError unless READY.
  void begin();
  /// Throws StateError unless running and not stopping.
  void requestExit();
  /// Throws StateError unless STOPPING.
  void end();
  /// What a system menu does: takes the input focus away (FOCUSED -> VISIBLE) or gives it back.
  void setInputFocus(bool focused);

  // --- Frame loop, strictly waitFrame -> beginFrame -> endFrame. Each throws StateError otherwise.

  /// `predicted_display_time` (ns, the frame's time) must not be before the previous frame's
  /// (InvalidArgument). At the first frame LOCAL space is centred anew.
  XrFrameState waitFrame(XrTime predicted_display_time, XrDuration period);
  void beginFrame();
  void endFrame();
  /// Time of the latest waitFrame; 0 before the first.
  XrTime frameTime() const { return frame_time_; }

  // --- Actions (action.hpp).

  /// Throws StateError after attachActionSets, InvalidArgument for a name used before or not of the
  /// characters a-z 0-9 - _ .
  ActionSet& createActionSet(const std::string& name);
  ActionSet* findActionSet(std::string_view name) const;
  /// Binds an action to an input or output such as "/user/hand/right/input/trigger/value". Throws
  /// StateError after attachActionSets; InvalidArgument for an unknown path (with the nearest known
  /// one), a path whose hand is none of the action's subaction hands or that does not fit the
  /// action's type.
  void suggestBinding(Action& action, std::string_view path);
  /// Fixes all action sets and bindings. Throws StateError the second time.
  void attachActionSets();
  bool attached() const { return attached_; }

  /// Samples the device once and updates all action states; they stay as they are until the next
  /// call. XR_SESSION_NOT_FOCUSED, and all actions inactive, unless FOCUSED. Throws StateError
  /// before attachActionSets.
  XrResult syncActions();

  /// State as of the latest syncActions. Without a hand: all of the action's hands combined
  /// (boolean: or; float and vector: the one furthest from 0). An inactive action reads 0. Throws
  /// StateError before attachActionSets; InvalidArgument naming the action for another type or for
  /// a hand it was not created with.
  XrActionStateBoolean getActionStateBoolean(const Action& action,
                                             std::optional<Hand> hand = std::nullopt) const;
  XrActionStateFloat getActionStateFloat(const Action& action,
                                         std::optional<Hand> hand = std::nullopt) const;
  XrActionStateVector2f getActionStateVector2f(const Action& action,
                                               std::optional<Hand> hand = std::nullopt) const;
  XrActionStatePose getActionStatePose(const Action& action,
                                       std::optional<Hand> hand = std::nullopt) const;

  /// Vibrates what the action is bound to. XR_SESSION_NOT_FOCUSED without effect unless FOCUSED.
  /// Throws as getActionState does, and InvalidArgument for a vibration that is not finite or
  /// outside its range.
  XrResult applyHapticFeedback(const Action& action, std::optional<Hand> hand,
                               const XrHapticVibration& vibration);
  XrResult stopHapticFeedback(const Action& action, std::optional<Hand> hand);

  // --- Spaces. STAGE: floor origin, the app's tracking space. VIEW: the head. LOCAL: STAGE's
  // origin
  //     raised to the head's height and turned to the head's yaw, as they are in the first frame
  //     after begin() or at recenter().

  /// Throws InvalidArgument for a type other than VIEW, LOCAL and STAGE.
  Space referenceSpace(XrReferenceSpaceType type, const XrPosef& offset = kIdentityPose) const;
  /// Throws InvalidArgument unless `action` is a pose action with this hand.
  Space actionSpace(const Action& action, Hand hand, const XrPosef& offset = kIdentityPose) const;
  void recenter();

  /// Pose of `space` in `base` at `time`. No flag is set, and the pose is the identity, where one
  /// of the two is an action space that is inactive since the latest syncActions. At the time of
  /// the latest sample (that of the frame) poses are that sample's; at another time the device is
  /// asked again.
  XrSpaceLocation locateSpace(const Space& space, const Space& base, XrTime time);
  /// The left and the right eye in `base`.
  std::vector<XrView> locateViews(XrTime time, const Space& base);

  /// All of it, the device's fields included. Loading needs the same action sets and bindings; it
  /// throws EngineError otherwise.
  void fields(Archive& archive);

 private:
  enum class FrameStage { idle, waited, begun };

  void enter(XrSessionState state);
  void requireRunning(const char* call) const;
  void requireStage(const char* call, FrameStage stage, const char* expected) const;
  void requireNotAttached(const char* call) const;
  const ActionState& actionState(const Action& action, XrActionType type,
                                 std::optional<Hand> hand) const;
  void requireAction(const Action& action, XrActionType type, std::optional<Hand> hand) const;
  const DeviceState& sampleFrame();
  DeviceState sampleAt(XrTime time);
  std::optional<XrPosef> locateInStage(const Space& space, const DeviceState& state) const;
  void fieldsOfActions(Archive& archive);

  Device& device_;
  SessionSettings settings_;
  XrSessionState state_ = XR_SESSION_STATE_UNKNOWN;
  std::deque<std::pair<XrSessionState, XrTime>> events_;
  FrameStage frame_stage_ = FrameStage::idle;
  XrTime frame_time_ = 0;
  bool any_frame_ = false;
  std::vector<std::unique_ptr<ActionSet>> action_sets_;
  bool attached_ = false;
  DeviceState sample_;
  bool sampled_ = false;  // sample_ is this frame's
  XrPosef stage_T_local_ = kIdentityPose;
};

}  // namespace sim2vr::xr

// SPDX-License-Identifier: Apache-2.0
#include "pointing/feedback.hpp"

#include <string>

namespace sim2vr::games::pointing {
namespace {

// 20 ms at half strength, at the frequency that the controller likes best.
constexpr XrHapticVibration kPulse{XR_TYPE_HAPTIC_VIBRATION, nullptr, 20'000'000,
                                   XR_FREQUENCY_UNSPECIFIED, 0.5F};

}  // namespace

Feedback::Feedback(xr::Session& session, rl::SoundLog& sounds, xr::Hand hand)
    : session_(&session), sounds_(&sounds), hand_(hand) {
  xr::ActionSet& set = session.createActionSet("pointing");
  xr::Action& vibration =
      session.createAction(set, "vibrate", XR_ACTION_TYPE_VIBRATION_OUTPUT, {hand});
  session.suggestBinding(vibration, hand == xr::Hand::left ? "/user/hand/left/output/haptic"
                                                           : "/user/hand/right/output/haptic");
  vibration_ = &vibration;
}

void Feedback::selection(std::string_view sound, const Vec3& place_m) {
  sounds_->play({std::string(sound), place_m});
  session_->applyHapticFeedback(*vibration_, hand_, kPulse);
}

}  // namespace sim2vr::games::pointing

// SPDX-License-Identifier: Apache-2.0
#include "beats/feedback.hpp"

#include <string>

#include "beats/saber.hpp"

namespace sim2vr::games::beats {

Feedback::Feedback(xr::Session& session, rl::SoundLog& sounds)
    : session_(&session), sounds_(&sounds) {
  xr::ActionSet& set = session.createActionSet("beats");
  xr::Action& vibration = session.createAction(set, "vibrate", XR_ACTION_TYPE_VIBRATION_OUTPUT);
  session.suggestBinding(vibration, "/user/hand/left/output/haptic");
  session.suggestBinding(vibration, "/user/hand/right/output/haptic");
  vibration_ = &vibration;
}

void Feedback::slice(Hand hand, const Vec3& place_m) {
  play("cut", place_m);
  vibrate(hand, {20, 0.5F});
}

void Feedback::wrongCut(Hand hand, const Vec3& place_m) {
  play("bad_cut", place_m);
  vibrate(hand, {60, 0.8F});
}

void Feedback::mine(Hand hand, const Vec3& place_m) {
  play("mine", place_m);
  vibrate(hand, {100, 1.0F});
}

void Feedback::wall(const Vec3& place_m) {
  play("wall", place_m);
  for (const Hand hand : {Hand::kLeft, Hand::kRight}) vibrate(hand, {50, 0.7F});
}

void Feedback::miss(const Vec3& place_m) { play("miss", place_m); }

void Feedback::vibrate(Hand hand, const Pulse& pulse) {
  constexpr XrDuration kNsPerMillisecond = 1'000'000;
  const XrHapticVibration vibration{XR_TYPE_HAPTIC_VIBRATION, nullptr,
                                    pulse.milliseconds * kNsPerMillisecond,
                                    XR_FREQUENCY_UNSPECIFIED, pulse.amplitude};
  session_->applyHapticFeedback(*vibration_, controllerOf(hand), vibration);
}

void Feedback::play(std::string_view sound, const Vec3& place_m) {
  sounds_->play({std::string(sound), place_m});
}

}  // namespace sim2vr::games::beats

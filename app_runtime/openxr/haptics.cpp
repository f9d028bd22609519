// SPDX-License-Identifier: Apache-2.0
// Vibrations that the program asks for: they go to the harness with the frame's time.
#include <utility>

#include "actions.hpp"
#include "calls.hpp"
#include "check.hpp"
#include "session_state.hpp"

namespace sim2vr::openxr {
namespace {

/// Sends one event per hand that the action is bound to.
void vibrate(Session& session, const Action& action, std::size_t hand,
             const XrHapticVibration& vibration) {
  Harness* harness = session.instance->harness.get();
  if (harness == nullptr) return;
  std::array<bool, 2> done{};
  for (const xr::Component* component : action.bindings) {
    const auto own = static_cast<std::size_t>(*component->hand);
    if ((hand != xr::kBothHands && own != hand) || std::exchange(done[own], true)) continue;
    harness->note({.kind = "haptic",
                   .text = own == 0 ? "left" : "right",
                   .amplitude = vibration.amplitude,
                   .frequency_hz = vibration.frequency,
                   .duration_ns = vibration.duration,
                   .time_ns = session.now()});
  }
}

XrResult vibrate(XrSession session, const XrHapticActionInfo* actionInfo,
                 const XrHapticVibration& vibration) {
  const auto self = liveSession(session);
  const auto& info = structure(actionInfo, XR_TYPE_HAPTIC_ACTION_INFO, "hapticActionInfo");
  const auto action = attachedAction(*self, info.action, XR_ACTION_TYPE_VIBRATION_OUTPUT);
  const std::size_t hand = subactionIndex(*self->instance, *action, info.subactionPath);
  if (!self->focused()) return XR_SESSION_NOT_FOCUSED;
  vibrate(*self, *action, hand, vibration);
  return XR_SUCCESS;
}

}  // namespace

XrResult XRAPI_CALL calls::xrApplyHapticFeedback(XrSession session,
                                                 const XrHapticActionInfo* hapticActionInfo,
                                                 const XrHapticBaseHeader* hapticFeedback) {
  return guarded("xrApplyHapticFeedback", [&](Lock&) {
    get<Session>(session, "session");
    requirePointer(hapticFeedback, "hapticFeedback");
    const auto& vibration = structure(reinterpret_cast<const XrHapticVibration*>(hapticFeedback),
                                      XR_TYPE_HAPTIC_VIBRATION, "hapticFeedback");
    if (!xr::isVibration(vibration)) {
      invalid(
          fmt::format("hapticFeedback has amplitude {}, frequency {} and duration {}, expected "
                      "0 to 1, 0 or more and -1 or more",
                      vibration.amplitude, vibration.frequency, vibration.duration));
    }
    return vibrate(session, hapticActionInfo, vibration);
  });
}

XrResult XRAPI_CALL calls::xrStopHapticFeedback(XrSession session,
                                                const XrHapticActionInfo* hapticActionInfo) {
  return guarded("xrStopHapticFeedback", [&](Lock&) {
    return vibrate(session, hapticActionInfo, {XR_TYPE_HAPTIC_VIBRATION, nullptr, 0, 0.0F, 0.0F});
  });
}

}  // namespace sim2vr::openxr

// SPDX-License-Identifier: Apache-2.0
// The states of a session, and how they follow one another.
#pragma once

#include <openxr/openxr.h>
#include <openxr/openxr_reflection.h>

namespace sim2vr::xr {

/// Calls `enter` with each state of a new session until it is READY.
template <class Enter>
void toReady(Enter enter) {
  enter(XR_SESSION_STATE_IDLE);
  enter(XR_SESSION_STATE_READY);
}

/// With each state from READY on to FOCUSED, as its first frame comes.
template <class Enter>
void toFocused(Enter enter) {
  enter(XR_SESSION_STATE_SYNCHRONIZED);
  enter(XR_SESSION_STATE_VISIBLE);
  enter(XR_SESSION_STATE_FOCUSED);
}

/// With each state from that of a running session on to STOPPING.
template <class Enter>
void toStopping(XrSessionState from, Enter enter) {
  if (from == XR_SESSION_STATE_FOCUSED) enter(XR_SESSION_STATE_VISIBLE);
  if (from != XR_SESSION_STATE_SYNCHRONIZED) enter(XR_SESSION_STATE_SYNCHRONIZED);
  enter(XR_SESSION_STATE_STOPPING);
}

/// For messages and logs, such as "FOCUSED".
inline const char* stateName(XrSessionState state) {
  switch (state) {
#define SIM2VR_STATE(name, number) \
  case name:                       \
    return &#name[sizeof "XR_SESSION_STATE"];
    XR_LIST_ENUM_XrSessionState(SIM2VR_STATE)
#undef SIM2VR_STATE
  }
  return "UNKNOWN";
}

}  // namespace sim2vr::xr

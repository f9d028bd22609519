// Words for messages.
#pragma once

#include <openxr/openxr.h>

#include <string>
#include <string_view>

#include "sim2vr/xr/device.hpp"

namespace sim2vr::xr {

/// Throws InvalidArgument unless `name` is fit for an action or action set.
void requireName(const char* what, const std::string& name);

inline std::string quote(std::string_view text) {
  return std::string("'").append(text).append("'");
}

inline const char* handName(Hand hand) { return hand == Hand::left ? "left" : "right"; }

inline const char* stateName(XrSessionState state) {
  switch (state) {
    case XR_SESSION_STATE_IDLE:
      return "IDLE";
    case XR_SESSION_STATE_READY:
      return "READY";
    case XR_SESSION_STATE_SYNCHRONIZED:
      return "SYNCHRONIZED";
    case XR_SESSION_STATE_VISIBLE:
      return "VISIBLE";
    case XR_SESSION_STATE_FOCUSED:
      return "FOCUSED";
    case XR_SESSION_STATE_STOPPING:
      return "STOPPING";
    case XR_SESSION_STATE_EXITING:
      return "EXITING";
    default:
      return "UNKNOWN";
  }
}

inline const char* typeName(XrActionType type) {
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
      return "unknown";
  }
}

}  // namespace sim2vr::xr

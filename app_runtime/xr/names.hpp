// Words for messages.
#pragma once

#include <openxr/openxr.h>

#include <string>
#include <string_view>

#include "sim2vr/xr/device.hpp"
#include "sim2vr/xr/state_name.hpp"

namespace sim2vr::xr {

/// Throws InvalidArgument unless `name` is fit for an action or action set.
void requireName(const char* what, const std::string& name);

inline std::string quote(std::string_view text) {
  return std::string("'").append(text).append("'");
}

inline const char* handName(Hand hand) { return hand == Hand::left ? "left" : "right"; }

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

// SPDX-License-Identifier: Apache-2.0
// The core's side of the graphics calls, without an instance: every call is allowed.
#include "graphics.hpp"

namespace sim2vr::openxr {

XrResult graphicsCall(const char*, XrInstance, XrSystemId system, std::string_view) {
  return system == 1 ? XR_SUCCESS : XR_ERROR_SYSTEM_INVALID;
}

XrResult graphicsFailed(const char*, XrResult result, std::string_view) { return result; }

}  // namespace sim2vr::openxr

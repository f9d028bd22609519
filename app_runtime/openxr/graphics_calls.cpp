// SPDX-License-Identifier: Apache-2.0
// What the functions of graphics extensions ask of the core.
#include "check.hpp"
#include "graphics.hpp"
#include "objects.hpp"

namespace sim2vr::openxr {

XrResult graphicsCall(const char* call, XrInstance instance, XrSystemId system,
                      std::string_view extension) {
  return guarded(call, [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    if (!owner->enabled(extension)) {
      throw Failure(XR_ERROR_FUNCTION_UNSUPPORTED, fmt::format("{} is not enabled", extension));
    }
    if (system != kSystem || !owner->system_asked) {
      throw Failure(XR_ERROR_SYSTEM_INVALID, fmt::format("no system {}", system));
    }
    owner->requirements_asked.emplace(call);
    return XR_SUCCESS;
  });
}

XrResult graphicsFailed(const char* call, XrResult result, std::string_view cause) {
  return failed(call, result, cause);
}

}  // namespace sim2vr::openxr

// SPDX-License-Identifier: Apache-2.0
// The extensions that this runtime has.
#pragma once

#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include "objects.hpp"

namespace sim2vr::openxr {

struct Extension {
  std::string_view name;
  std::uint32_t version;
};
/// Ours, and those of the graphics that were built in.
const std::vector<Extension>& extensions();

/// XR_EXT_debug_utils: a messenger of this instance.
XrDebugUtilsMessengerEXT addMessenger(Instance& instance,
                                      const XrDebugUtilsMessengerCreateInfoEXT& info);

/// A session ends, whatever its state: the harness is told once.
void leave(Session& session, const char* call);

}  // namespace sim2vr::openxr

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "objects.hpp"

namespace sim2vr::openxr {

XrPath toPath(Instance& instance, std::string_view text);
/// Throws Failure (XR_ERROR_PATH_INVALID) naming `what`.
const std::string& pathText(const Instance& instance, XrPath path, const char* what);

}  // namespace sim2vr::openxr

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace sim2vr {

/// The project's version, "major.minor.patch", from the file VERSION.
std::string_view version();

}  // namespace sim2vr

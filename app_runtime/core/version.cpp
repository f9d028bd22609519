// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/version.hpp"

namespace sim2vr {

std::string_view version() { return SIM2VR_VERSION; }

}  // namespace sim2vr

// SPDX-License-Identifier: Apache-2.0
// What distinguishes levels.
#pragma once

#include <string>
#include <string_view>

#include "beats/level.hpp"

namespace sim2vr::games::beats {

/// 64-bit FNV-1a, 16 hexadecimal digits: of the bytes that a level was read from.
std::string bytesHash(std::string_view bytes);

/// The same of everything that a level holds but its hash: for levels that are made, not read.
std::string contentHash(Level level);

}  // namespace sim2vr::games::beats

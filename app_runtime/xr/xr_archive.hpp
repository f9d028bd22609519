// SPDX-License-Identifier: Apache-2.0
// Saves Khronos' plain structs, which cannot have a fields() of their own.
#pragma once

#include <openxr/openxr.h>

#include <array>
#include <string_view>

#include "sim2vr/core/archive.hpp"

namespace sim2vr::xr {

inline void poseField(Archive& archive, std::string_view name, XrPosef& pose) {
  std::array<float, 7> values{pose.orientation.x, pose.orientation.y, pose.orientation.z,
                              pose.orientation.w, pose.position.x,    pose.position.y,
                              pose.position.z};
  archive.field(name, values);
  pose = {{values[0], values[1], values[2], values[3]}, {values[4], values[5], values[6]}};
}

inline void vectorField(Archive& archive, std::string_view name, XrVector2f& vector) {
  std::array<float, 2> values{vector.x, vector.y};
  archive.field(name, values);
  vector = {values[0], values[1]};
}

}  // namespace sim2vr::xr

// SPDX-License-Identifier: Apache-2.0
// Physics layers of Whac-A-Mole. Only this pair collides.
#pragma once

namespace sim2vr::games::whacamole {

inline constexpr int kTargetLayer = 10;
inline constexpr int kPlayerLayer = 11;

}  // namespace sim2vr::games::whacamole

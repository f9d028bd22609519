// SPDX-License-Identifier: Apache-2.0
// Cut directions as vectors and back.
#pragma once

#include <Eigen/Core>

#include "beats/level.hpp"

namespace sim2vr::games::beats {

/// Unit vector of a blade's motion as the player sees it, right and up; zero for kAny.
Eigen::Vector2d directionVector(CutDirection direction);

/// The same of a box, its angle offset included.
Eigen::Vector2d cutVector(const Box& box);

/// The direction back; kAny stays.
CutDirection opposite(CutDirection direction);

}  // namespace sim2vr::games::beats

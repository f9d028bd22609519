// SPDX-License-Identifier: Apache-2.0
// What a camera could show.
#pragma once

#include "sim2vr/core/math.hpp"
#include "sim2vr/render/components.hpp"

namespace sim2vr::rl {

/// Whether a world point lies in what `camera` shows in images of `aspect` (width / height):
/// between its clipping planes and within its angles, the borders included. Nothing occludes here.
bool inView(const render::Camera& camera, double aspect, const Vec3& point_m);

}  // namespace sim2vr::rl

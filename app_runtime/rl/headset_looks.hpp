// What people who watch from outside see of the player: a head that wears a headset.
#pragma once

#include "sim2vr/scene/game_object.hpp"

namespace sim2vr::rl {

/// Adds the looks below the head camera, all of them on `layer`. The camera's origin is between the
/// eyes; it must not see the layer, as it is inside.
void addHeadsetLooks(scene::GameObject& head_camera, int layer);

}  // namespace sim2vr::rl

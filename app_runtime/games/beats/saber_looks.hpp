// What the sabers look like.
#pragma once

#include "beats/level.hpp"
#include "beats/sweep.hpp"
#include "sim2vr/scene/game_object.hpp"

namespace sim2vr::games::beats {

/// A short handle, a ring and a thin straight blade along the controller's +z.
void addSaberLooks(scene::GameObject& controller, Hand hand, const Rod& blade);

}  // namespace sim2vr::games::beats

// What does not belong to a level: rails, and the cameras of those who watch.
#pragma once

#include "sim2vr/core/math.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::games::beats {

/// Adds two rails below an object that is to be put at the round's origin, cameras, and a light for
/// what is not the game's own (the headset in pictures from outside). Returns that object.
scene::GameObject& addRoomLooks(scene::Scene& scene);

/// Puts rails and cameras to where the player stands.
void placeRoom(scene::GameObject& lane, const Vec3& origin_m);

}  // namespace sim2vr::games::beats

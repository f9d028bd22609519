// Pictures of a game from outside, for games that bring no cameras for them.
#pragma once

#include "sim2vr/scene/scene.hpp"

namespace sim2vr::rl {

/// Adds what the round's scene lacks: cameras at kThirdPersonCameraPath and kSpectatorCameraPath,
/// and, with either, something to see for controllers that show nothing (kPlayerLooksLayer).
///
/// The cameras are put up in the round's first frame, relative to where the head is then and where
/// it faces (its heading; pitch and roll do not count), and stay there: the spectator's to the
/// right, behind and above, so that head, hands and what lies within reach are in view; the third
/// person's behind and above, close.
void addOutsideCameras(scene::Scene& scene);

}  // namespace sim2vr::rl

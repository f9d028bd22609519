// Meshes of boxes, mines and walls, made once.
#pragma once

#include "sim2vr/render/mesh.hpp"

namespace sim2vr::games::beats {

/// A cube of edge 1 as a frame of bars; on the side that faces the player (-z) a filled triangle
/// that points down, or a disc for boxes of any direction.
render::MeshPtr arrowBox();
render::MeshPtr dotBox();
/// A star of eight spikes that reach 1 from the middle: two tetrahedra.
render::MeshPtr star();
/// A cube of edge 1 whose sides are stripes, half of each open.
render::MeshPtr stripedBlock();

}  // namespace sim2vr::games::beats

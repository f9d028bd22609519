// SPDX-License-Identifier: Apache-2.0
// A still life with the shapes, colours and lights of the Whac-A-Mole study, to judge the renderer
// by. The game itself builds its own objects.
#pragma once

#include "sim2vr/render/components.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::render::demo {

/// Sky and main light as in the study.
void addSurroundings(scene::Scene& scene);
/// Targets, target area, hammer, controller, platform, arrow and burst: about 1,600 triangles.
void addObjects(scene::Scene& scene);

/// Camera of the simulated user: 90 degrees, 10 degrees down.
Camera& addHeadCamera(scene::Scene& scene);
/// Camera of the published figure's panels, fitted to its sky and targets.
Camera& addFigureCamera(scene::Scene& scene);

}  // namespace sim2vr::render::demo

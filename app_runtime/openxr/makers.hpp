// SPDX-License-Identifier: Apache-2.0
// One way to draw per file, gathered by graphics.cpp.
#pragma once

#include "graphics.hpp"

namespace sim2vr::openxr {

GraphicsMaker openglMaker();
GraphicsMaker eglMaker();
GraphicsMaker vulkanMaker();
GraphicsMaker vulkan2Maker();

}  // namespace sim2vr::openxr

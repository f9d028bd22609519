// SPDX-License-Identifier: Apache-2.0
#include "graphics.hpp"

#include <vector>

namespace sim2vr::openxr {

std::span<const GraphicsMaker> graphicsMakers() {
  static const std::vector<GraphicsMaker> makers = {
#ifdef SIM2VR_OPENXR_VULKAN
      vulkan2Maker(),
      vulkanMaker(),
#endif
#ifdef SIM2VR_OPENXR_OPENGL
      openglMaker(),
#endif
#ifdef SIM2VR_OPENXR_EGL
      eglMaker(),
#endif
  };
  return makers;
}

}  // namespace sim2vr::openxr

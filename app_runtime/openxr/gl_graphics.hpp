// SPDX-License-Identifier: Apache-2.0
// OpenGL in the program's own context, whatever window system it came from: textures for
// swapchains and their pixels. The program finds its context's state as it left it.
#pragma once

#include <memory>
#include <string_view>

#include "graphics.hpp"

namespace sim2vr::openxr {

/// The program's OpenGL context, made current for the length of one call.
class GlContext {
 public:
  virtual ~GlContext() = default;
  virtual void* lookup(const char* name) const = 0;
  /// Makes the context current unless it is; throws GraphicsError when it cannot be.
  virtual void enter() = 0;
  /// Makes current again what was current before enter().
  virtual void leave() noexcept = 0;
};

/// Throws GraphicsError (XR_ERROR_GRAPHICS_DEVICE_INVALID) for contexts older than OpenGL 4.2.
std::unique_ptr<Graphics> createGlGraphics(std::string_view name,
                                           std::unique_ptr<GlContext> context);

/// xrGetOpenGLGraphicsRequirementsKHR under XR_KHR_opengl_enable, or null for another name.
PFN_xrVoidFunction glRequirementsFunction(std::string_view name);

}  // namespace sim2vr::openxr

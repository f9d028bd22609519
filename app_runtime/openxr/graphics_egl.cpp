// SPDX-License-Identifier: Apache-2.0
// XR_MNDX_egl_enable: OpenGL contexts of EGL, with or without a window or a screen.
#define EGL_NO_X11
#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <dlfcn.h>
#include <fmt/format.h>

#define XR_USE_PLATFORM_EGL
#define XR_USE_GRAPHICS_API_OPENGL
#include <openxr/openxr_platform.h>

#include "gl_graphics.hpp"
#include "graphics.hpp"

namespace sim2vr::openxr {
namespace {

class EglProgramContext final : public GlContext {
 public:
  explicit EglProgramContext(const XrGraphicsBindingEGLMNDX& binding)
      : get_proc_address_(binding.getProcAddress),
        display_(binding.display),
        context_(binding.context) {
    if (get_proc_address_ == nullptr || display_ == EGL_NO_DISPLAY || context_ == EGL_NO_CONTEXT) {
      throw GraphicsError(XR_ERROR_GRAPHICS_DEVICE_INVALID,
                          "XrGraphicsBindingEGLMNDX lacks getProcAddress, display or context");
    }
    find("eglBindAPI", bind_api_);
    find("eglQueryAPI", query_api_);
    find("eglMakeCurrent", make_current_);
    find("eglGetCurrentContext", current_context_);
    find("eglGetCurrentDisplay", current_display_);
    find("eglGetCurrentSurface", current_surface_);
    find("eglQueryContext", query_context_);
    find("eglGetError", get_error_);
    EGLint type = 0;
    if (query_context_(display_, context_, EGL_CONTEXT_CLIENT_TYPE, &type) != EGL_TRUE ||
        type != EGL_OPENGL_API) {
      throw GraphicsError(XR_ERROR_GRAPHICS_DEVICE_INVALID,
                          "XrGraphicsBindingEGLMNDX::context is not an OpenGL context of display");
    }
  }

  void* lookup(const char* name) const override {
    return reinterpret_cast<void*>(get_proc_address_(name));
  }

  void enter() override {
    api_ = query_api_();
    if (api_ != EGL_OPENGL_API) bind_api_(EGL_OPENGL_API);
    before_ = current_context_();
    if (before_ == context_) return;
    display_before_ = current_display_();
    draw_before_ = current_surface_(EGL_DRAW);
    read_before_ = current_surface_(EGL_READ);
    if (make_current_(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, context_) == EGL_TRUE) return;
    const EGLint error = get_error_();
    leave();
    throw GraphicsError(
        XR_ERROR_RUNTIME_FAILURE,
        fmt::format("the program's EGL context cannot be made current without a surface (EGL "
                    "error {:#x}); is it current in another thread?",
                    error));
  }

  void leave() noexcept override {
    if (before_ != context_) {
      const bool none = before_ == EGL_NO_CONTEXT;
      make_current_(none ? display_ : display_before_, draw_before_, read_before_, before_);
    }
    if (api_ != EGL_OPENGL_API) bind_api_(api_);
  }

 private:
  template <class Function>
  void find(const char* name, Function& function) const {
    // EGL before 1.5 hands out its own functions through the library only.
    void* found = lookup(name);
    if (found == nullptr) {
      void* library = dlopen("libEGL.so.1", RTLD_NOW | RTLD_LOCAL);
      if (library != nullptr) found = dlsym(library, name);
    }
    if (found == nullptr) {
      throw GraphicsError(XR_ERROR_GRAPHICS_DEVICE_INVALID,
                          fmt::format("the program's EGL has no {}", name));
    }
    function = reinterpret_cast<Function>(found);
  }

  PFNEGLGETPROCADDRESSPROC get_proc_address_;
  EGLDisplay display_;
  EGLContext context_;
  decltype(&eglBindAPI) bind_api_ = nullptr;
  decltype(&eglQueryAPI) query_api_ = nullptr;
  decltype(&eglMakeCurrent) make_current_ = nullptr;
  decltype(&eglGetCurrentContext) current_context_ = nullptr;
  decltype(&eglGetCurrentDisplay) current_display_ = nullptr;
  decltype(&eglGetCurrentSurface) current_surface_ = nullptr;
  decltype(&eglQueryContext) query_context_ = nullptr;
  decltype(&eglGetError) get_error_ = nullptr;
  EGLenum api_ = EGL_OPENGL_API;
  EGLContext before_ = EGL_NO_CONTEXT;
  EGLDisplay display_before_ = EGL_NO_DISPLAY;
  EGLSurface draw_before_ = EGL_NO_SURFACE;
  EGLSurface read_before_ = EGL_NO_SURFACE;
};

std::unique_ptr<Graphics> create(const XrBaseInStructure& binding) {
  const auto& egl = reinterpret_cast<const XrGraphicsBindingEGLMNDX&>(binding);
  return createGlGraphics("egl", std::make_unique<EglProgramContext>(egl));
}

PFN_xrVoidFunction function(std::string_view) { return nullptr; }

}  // namespace

GraphicsMaker eglMaker() {
  return {XR_MNDX_EGL_ENABLE_EXTENSION_NAME,
          XR_MNDX_egl_enable_SPEC_VERSION,
          XR_TYPE_GRAPHICS_BINDING_EGL_MNDX,
          "",
          create,
          function};
}

}  // namespace sim2vr::openxr

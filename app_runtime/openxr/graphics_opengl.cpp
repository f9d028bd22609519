// SPDX-License-Identifier: Apache-2.0
// XR_KHR_opengl_enable with Xlib's binding: OpenGL contexts of GLX.
#include <dlfcn.h>
#include <fmt/format.h>

#include "gl_graphics.hpp"
#include "graphics.hpp"

// After the others: Xlib defines macros with everyday names.
#include <GL/glx.h>
#include <X11/Xlib.h>
#define XR_USE_PLATFORM_XLIB
#define XR_USE_GRAPHICS_API_OPENGL
#include <openxr/openxr_platform.h>

namespace sim2vr::openxr {
namespace {

int ignoreError(Display*, XErrorEvent*) { return 0; }

class GlxProgramContext final : public GlContext {
 public:
  explicit GlxProgramContext(const XrGraphicsBindingOpenGLXlibKHR& binding)
      : display_(binding.xDisplay), drawable_(binding.glxDrawable), context_(binding.glxContext) {
    if (display_ == nullptr || context_ == nullptr) {
      throw GraphicsError(XR_ERROR_GRAPHICS_DEVICE_INVALID,
                          "XrGraphicsBindingOpenGLXlibKHR lacks xDisplay or glxContext");
    }
    library_ = dlopen("libGL.so.1", RTLD_NOW | RTLD_LOCAL);
    if (library_ == nullptr) throw GraphicsError(XR_ERROR_GRAPHICS_DEVICE_INVALID, dlerror());
    void* x11 = dlopen("libX11.so.6", RTLD_NOW | RTLD_LOCAL);
    if (x11 == nullptr) throw GraphicsError(XR_ERROR_GRAPHICS_DEVICE_INVALID, dlerror());
    set_error_handler_ =
        reinterpret_cast<decltype(&XSetErrorHandler)>(dlsym(x11, "XSetErrorHandler"));
    find("glXGetProcAddressARB", get_proc_address_);
    find("glXMakeContextCurrent", make_current_);
    find("glXGetCurrentContext", current_context_);
    find("glXGetCurrentDisplay", current_display_);
    find("glXGetCurrentDrawable", current_drawable_);
    find("glXGetCurrentReadDrawable", current_read_drawable_);
  }

  void* lookup(const char* name) const override {
    return reinterpret_cast<void*>(get_proc_address_(reinterpret_cast<const GLubyte*>(name)));
  }

  void enter() override {
    before_ = current_context_();
    if (before_ == context_) return;
    display_before_ = current_display_();
    draw_before_ = current_drawable_();
    read_before_ = current_read_drawable_();
    // Xlib's own handler would end the program.
    const auto handler = set_error_handler_(ignoreError);
    const bool made = make_current_(display_, drawable_, drawable_, context_) != False;
    set_error_handler_(handler);
    if (made) return;
    leave();
    throw GraphicsError(XR_ERROR_RUNTIME_FAILURE,
                        "the program's GLX context cannot be made current; is it destroyed, or "
                        "current in another thread?");
  }

  void leave() noexcept override {
    if (before_ == context_) return;
    const bool none = before_ == nullptr;
    make_current_(none ? display_ : display_before_, draw_before_, read_before_, before_);
  }

 private:
  template <class Function>
  void find(const char* name, Function& function) const {
    function = reinterpret_cast<Function>(dlsym(library_, name));
    if (function == nullptr) {
      throw GraphicsError(XR_ERROR_GRAPHICS_DEVICE_INVALID, fmt::format("libGL has no {}", name));
    }
  }

  Display* display_;
  GLXDrawable drawable_;
  GLXContext context_;
  void* library_ = nullptr;  // stays open: the program uses it too
  decltype(&XSetErrorHandler) set_error_handler_ = nullptr;
  decltype(&glXGetProcAddressARB) get_proc_address_ = nullptr;
  decltype(&glXMakeContextCurrent) make_current_ = nullptr;
  decltype(&glXGetCurrentContext) current_context_ = nullptr;
  decltype(&glXGetCurrentDisplay) current_display_ = nullptr;
  decltype(&glXGetCurrentDrawable) current_drawable_ = nullptr;
  decltype(&glXGetCurrentReadDrawable) current_read_drawable_ = nullptr;
  GLXContext before_ = nullptr;
  Display* display_before_ = nullptr;
  GLXDrawable draw_before_ = 0;
  GLXDrawable read_before_ = 0;
};

std::unique_ptr<Graphics> create(const XrBaseInStructure& binding) {
  const auto& xlib = reinterpret_cast<const XrGraphicsBindingOpenGLXlibKHR&>(binding);
  return createGlGraphics("opengl", std::make_unique<GlxProgramContext>(xlib));
}

}  // namespace

GraphicsMaker openglMaker() {
  return {XR_KHR_OPENGL_ENABLE_EXTENSION_NAME,
          XR_KHR_opengl_enable_SPEC_VERSION,
          XR_TYPE_GRAPHICS_BINDING_OPENGL_XLIB_KHR,
          "xrGetOpenGLGraphicsRequirementsKHR",
          create,
          glRequirementsFunction};
}

}  // namespace sim2vr::openxr

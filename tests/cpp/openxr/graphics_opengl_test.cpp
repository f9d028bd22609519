// SPDX-License-Identifier: Apache-2.0
// Swapchains of a program that draws with OpenGL over Xlib, on an Xvfb of its own. What does not
// depend on the window system is in graphics_egl_test.cpp.
#include <dlfcn.h>
#include <gtest/gtest.h>
#include <link.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "graphics.hpp"
#include "sim2vr/gl/functions.hpp"
#include "typed.hpp"

// After the others: Xlib defines macros with everyday names.
#include <GL/glx.h>
#include <X11/Xlib.h>
#define XR_USE_PLATFORM_XLIB
#define XR_USE_GRAPHICS_API_OPENGL
#include <openxr/openxr_platform.h>

namespace sim2vr::openxr {
namespace {

/// An X server without a screen, for as long as this lives.
class Xvfb {
 public:
  Xvfb() {
    std::array<int, 2> ends{};
    if (pipe(ends.data()) != 0) return;
    process_ = fork();
    if (process_ == 0) {
      const std::string end = std::to_string(ends[1]);
      close(ends[0]);
      prctl(PR_SET_PDEATHSIG, SIGTERM);  // where a test ends the process
      execlp("Xvfb", "Xvfb", "-displayfd", end.c_str(), "-screen", "0", "64x48x24", "-nolisten",
             "tcp", nullptr);
      _exit(127);
    }
    close(ends[1]);
    // A line with the number, in more than one piece.
    pollfd ready = {ends[0], POLLIN, 0};
    std::string line;
    char letter = 0;
    while (poll(&ready, 1, 20'000) == 1 && ::read(ends[0], &letter, 1) == 1 && letter != '\n') {
      line += letter;
    }
    if (letter == '\n') display = ":" + line;
    close(ends[0]);
  }

  ~Xvfb() {
    if (process_ <= 0) return;
    kill(process_, SIGTERM);
    waitpid(process_, nullptr, 0);
  }
  Xvfb(const Xvfb&) = delete;
  Xvfb& operator=(const Xvfb&) = delete;

  std::string display;  // empty: there is none

 private:
  pid_t process_ = -1;
};

class GraphicsOpenGl : public testing::Test {
 protected:
  void SetUp() override {
    x11_ = dlopen("libX11.so.6", RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
    gl_ = dlopen("libGL.so.1", RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
    if (x11_ == nullptr || gl_ == nullptr) GTEST_SKIP() << "no libX11 or no libGL";
    xvfb_.emplace();
    if (xvfb_->display.empty()) GTEST_SKIP() << "Xvfb does not start";
    display_ = x11<decltype(&XOpenDisplay)>("XOpenDisplay")(xvfb_->display.c_str());
    ASSERT_NE(display_, nullptr);
    const std::array<int, 5> wanted = {GLX_RENDER_TYPE, GLX_RGBA_BIT, GLX_DRAWABLE_TYPE,
                                       GLX_PBUFFER_BIT, 0};
    int count = 0;
    GLXFBConfig* configs =
        glx<decltype(&glXChooseFBConfig)>("glXChooseFBConfig")(display_, 0, wanted.data(), &count);
    ASSERT_GT(count, 0);
    config_ = configs[0];
    x11<decltype(&XFree)>("XFree")(configs);
    const std::array<int, 5> size = {GLX_PBUFFER_WIDTH, 8, GLX_PBUFFER_HEIGHT, 8, 0};
    drawable_ =
        glx<decltype(&glXCreatePbuffer)>("glXCreatePbuffer")(display_, config_, size.data());
    context_ = createContext();
    ASSERT_NE(context_, nullptr);
    makeCurrent(context_);
    // The driver stays loaded, so that a report of leaks can name it.
    std::string driver;
    dl_iterate_phdr(
        [](dl_phdr_info* library, std::size_t, void* found) {
          const std::string name = library->dlpi_name;
          if (name.ends_with("_dri.so")) *static_cast<std::string*>(found) = name;
          return 0;
        },
        &driver);
    if (!driver.empty()) dlopen(driver.c_str(), RTLD_NOW | RTLD_NODELETE);
  }

  void TearDown() override {
    if (display_ == nullptr) return;
    makeCurrent(nullptr);
    if (drawable_ != 0) {
      glx<decltype(&glXDestroyPbuffer)>("glXDestroyPbuffer")(display_, drawable_);
    }
    if (context_ != nullptr) {
      glx<decltype(&glXDestroyContext)>("glXDestroyContext")(display_, context_);
    }
    // The display stays open: closing it unloads Mesa's driver, and what the driver does not free
    // would be a leak without the name by which sanitizers leave drivers alone.
  }

  template <class Function>
  Function x11(const char* name) const {
    return reinterpret_cast<Function>(dlsym(x11_, name));
  }
  template <class Function>
  Function glx(const char* name) const {
    return reinterpret_cast<Function>(dlsym(gl_, name));
  }

  GLXContext createContext() const {
    return glx<decltype(&glXCreateNewContext)>("glXCreateNewContext")(display_, config_,
                                                                      GLX_RGBA_TYPE, nullptr, True);
  }
  void makeCurrent(GLXContext context) const {
    const GLXDrawable drawable = context == nullptr ? 0 : drawable_;
    glx<decltype(&glXMakeContextCurrent)>("glXMakeContextCurrent")(display_, drawable, drawable,
                                                                   context);
  }
  GLXContext current() const {
    return glx<decltype(&glXGetCurrentContext)>("glXGetCurrentContext")();
  }

  std::unique_ptr<Graphics> graphics(Display* display, GLXContext context) const {
    auto binding = typed<XrGraphicsBindingOpenGLXlibKHR>(XR_TYPE_GRAPHICS_BINDING_OPENGL_XLIB_KHR);
    binding.xDisplay = display;
    binding.glxFBConfig = config_;
    binding.glxDrawable = drawable_;
    binding.glxContext = context;
    return openglMaker().create(reinterpret_cast<const XrBaseInStructure&>(binding));
  }

  std::optional<Xvfb> xvfb_;
  void* x11_ = nullptr;
  void* gl_ = nullptr;
  Display* display_ = nullptr;
  GLXFBConfig config_ = nullptr;
  GLXDrawable drawable_ = 0;
  GLXContext context_ = nullptr;
};

TEST_F(GraphicsOpenGl, ReadsWhateverContextIsCurrent) {
  auto graphics = this->graphics(display_, context_);
  EXPECT_EQ(graphics->name(), "opengl");
  auto info = typed<XrSwapchainCreateInfo>(XR_TYPE_SWAPCHAIN_CREATE_INFO);
  info.format = GL_RGBA8;
  info.sampleCount = info.faceCount = info.arraySize = info.mipCount = 1;
  info.width = 6;
  info.height = 4;
  auto images = graphics->createImages(info);
  std::vector<XrSwapchainImageOpenGLKHR> list(
      images->count(), typed<XrSwapchainImageOpenGLKHR>(XR_TYPE_SWAPCHAIN_IMAGE_OPENGL_KHR));
  images->describe(reinterpret_cast<XrSwapchainImageBaseHeader*>(list.data()));

  const auto lookup = glx<decltype(&glXGetProcAddressARB)>("glXGetProcAddressARB");
  const auto find = [&](const char* name) {
    return reinterpret_cast<void*>(lookup(reinterpret_cast<const GLubyte*>(name)));
  };
  const gl::Functions gl(find, [](const char* name) { throw std::runtime_error(name); });
  GLuint framebuffer = 0;
  gl.GenFramebuffers(1, &framebuffer);
  gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
  gl.FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, list[0].image,
                          0);
  reinterpret_cast<PFNGLCLEARCOLORPROC>(find("glClearColor"))(0.2F, 1, 0, 1);
  reinterpret_cast<PFNGLCLEARPROC>(find("glClear"))(GL_COLOR_BUFFER_BIT);
  gl.DeleteFramebuffers(1, &framebuffer);

  const GLXContext other = createContext();
  for (const GLXContext context : {context_, other, GLXContext{nullptr}}) {
    makeCurrent(context);
    std::array<std::uint8_t, 96> rgba{};
    graphics->readColor({images.get(), 0, 0, {{0, 0}, {6, 4}}}, 6, 4, rgba);
    EXPECT_EQ(rgba[92], 124);
    EXPECT_EQ(rgba[93], 255);
    EXPECT_EQ(rgba[94], 0);
    EXPECT_EQ(current(), context);
  }
  images.reset();
  graphics.reset();
  EXPECT_EQ(current(), nullptr);
  makeCurrent(context_);
  EXPECT_EQ(reinterpret_cast<PFNGLISTEXTUREPROC>(find("glIsTexture"))(list[0].image),
            GLboolean{GL_FALSE});
  glx<decltype(&glXDestroyContext)>("glXDestroyContext")(display_, other);
}

TEST_F(GraphicsOpenGl, ADestroyedContextIsLeftAlone) {
  auto graphics = this->graphics(display_, context_);
  auto info = typed<XrSwapchainCreateInfo>(XR_TYPE_SWAPCHAIN_CREATE_INFO);
  info.format = GL_RGBA8;
  info.sampleCount = info.faceCount = info.arraySize = info.mipCount = 1;
  info.width = info.height = 4;
  auto images = graphics->createImages(info);
  makeCurrent(nullptr);
  glx<decltype(&glXDestroyContext)>("glXDestroyContext")(display_, context_);
  context_ = nullptr;
  images.reset();
  graphics.reset();
}

TEST_F(GraphicsOpenGl, BindingsThatCannotBe) {
  const auto refused = [&](Display* display, GLXContext context) {
    try {
      graphics(display, context);
    } catch (const GraphicsError& error) {
      return error.result();
    }
    return XR_SUCCESS;
  };
  EXPECT_EQ(refused(nullptr, context_), XR_ERROR_GRAPHICS_DEVICE_INVALID);
  EXPECT_EQ(refused(display_, nullptr), XR_ERROR_GRAPHICS_DEVICE_INVALID);
}

TEST(OpenGlRequirements, AreFourTwoToFourSix) {
  const auto get = reinterpret_cast<PFN_xrGetOpenGLGraphicsRequirementsKHR>(
      openglMaker().function("xrGetOpenGLGraphicsRequirementsKHR"));
  auto wanted = typed<XrGraphicsRequirementsOpenGLKHR>(XR_TYPE_GRAPHICS_REQUIREMENTS_OPENGL_KHR);
  EXPECT_EQ(get(XR_NULL_HANDLE, 1, &wanted), XR_SUCCESS);
  EXPECT_EQ(wanted.minApiVersionSupported, XR_MAKE_VERSION(4, 2, 0));
  EXPECT_EQ(wanted.maxApiVersionSupported, XR_MAKE_VERSION(4, 6, 0));
  EXPECT_EQ(get(XR_NULL_HANDLE, 2, &wanted), XR_ERROR_SYSTEM_INVALID);
  EXPECT_EQ(get(XR_NULL_HANDLE, 1, nullptr), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(openglMaker().function("xrCreateInstance"), nullptr);
}

}  // namespace
}  // namespace sim2vr::openxr

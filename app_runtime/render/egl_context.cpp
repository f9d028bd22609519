// SPDX-License-Identifier: Apache-2.0
// EGL without a window. libEGL is loaded on demand, so that machines without it still start.
#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <dlfcn.h>
#include <fmt/format.h>

#include <array>
#include <cstdlib>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "gl_context.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::render {
namespace {

constexpr const char* kMending =
    "install the packages libegl1 and libegl-mesa0 (with libgl1-mesa-dri), or the GPU vendor's EGL";

struct EglApi {
  decltype(&eglGetProcAddress) GetProcAddress = nullptr;
  decltype(&eglQueryString) QueryString = nullptr;
  decltype(&eglInitialize) Initialize = nullptr;
  decltype(&eglBindAPI) BindAPI = nullptr;
  decltype(&eglQueryAPI) QueryAPI = nullptr;
  decltype(&eglChooseConfig) ChooseConfig = nullptr;
  decltype(&eglCreateContext) CreateContext = nullptr;
  decltype(&eglDestroyContext) DestroyContext = nullptr;
  decltype(&eglMakeCurrent) MakeCurrent = nullptr;
  decltype(&eglGetCurrentContext) GetCurrentContext = nullptr;
  decltype(&eglGetCurrentDisplay) GetCurrentDisplay = nullptr;
  decltype(&eglGetCurrentSurface) GetCurrentSurface = nullptr;
  decltype(&eglGetError) GetError = nullptr;
  PFNEGLGETPLATFORMDISPLAYEXTPROC GetPlatformDisplay = nullptr;
  PFNEGLQUERYDEVICESEXTPROC QueryDevices = nullptr;
  std::string problem;
};

template <class Function>
void find(void* library, const char* name, Function& function, std::string& problem) {
  function = reinterpret_cast<Function>(dlsym(library, name));
  if (function == nullptr && problem.empty()) problem = fmt::format("libEGL has no {}", name);
}

EglApi loadEgl() {
  EglApi egl;
  void* library = dlopen("libEGL.so.1", RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) {
    egl.problem = dlerror();
    return egl;
  }
  find(library, "eglGetProcAddress", egl.GetProcAddress, egl.problem);
  find(library, "eglQueryString", egl.QueryString, egl.problem);
  find(library, "eglInitialize", egl.Initialize, egl.problem);
  find(library, "eglBindAPI", egl.BindAPI, egl.problem);
  find(library, "eglQueryAPI", egl.QueryAPI, egl.problem);
  find(library, "eglChooseConfig", egl.ChooseConfig, egl.problem);
  find(library, "eglCreateContext", egl.CreateContext, egl.problem);
  find(library, "eglDestroyContext", egl.DestroyContext, egl.problem);
  find(library, "eglMakeCurrent", egl.MakeCurrent, egl.problem);
  find(library, "eglGetCurrentContext", egl.GetCurrentContext, egl.problem);
  find(library, "eglGetCurrentDisplay", egl.GetCurrentDisplay, egl.problem);
  find(library, "eglGetCurrentSurface", egl.GetCurrentSurface, egl.problem);
  find(library, "eglGetError", egl.GetError, egl.problem);
  if (!egl.problem.empty()) return egl;
  egl.GetPlatformDisplay = reinterpret_cast<PFNEGLGETPLATFORMDISPLAYEXTPROC>(
      egl.GetProcAddress("eglGetPlatformDisplayEXT"));
  egl.QueryDevices =
      reinterpret_cast<PFNEGLQUERYDEVICESEXTPROC>(egl.GetProcAddress("eglQueryDevicesEXT"));
  return egl;
}

const EglApi& egl() {
  static const EglApi api = loadEgl();
  return api;
}

/// True when `name` is one of the space-separated words of `extensions`.
bool hasExtension(const char* extensions, std::string_view name) {
  const std::string padded = fmt::format(" {} ", extensions == nullptr ? "" : extensions);
  return padded.find(fmt::format(" {} ", name)) != std::string::npos;
}

struct Candidate {
  std::string platform;
  EGLenum platform_enum;
  void* native;
};

/// The displays to try, in order. SIM2VR_EGL_PLATFORM = surfaceless or device restricts them.
std::vector<Candidate> candidates() {
  const char* wanted_text = std::getenv("SIM2VR_EGL_PLATFORM");
  const std::string_view wanted = wanted_text == nullptr ? "" : wanted_text;
  if (!wanted.empty() && wanted != "surfaceless" && wanted != "device") {
    throw RenderError(fmt::format(
        "SIM2VR_EGL_PLATFORM is '{}', expected 'surfaceless', 'device' or nothing", wanted));
  }
  const char* extensions = egl().QueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
  std::vector<Candidate> list;
  if (wanted != "device" && hasExtension(extensions, "EGL_MESA_platform_surfaceless")) {
    list.push_back({"EGL surfaceless", EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY});
  }
  if (wanted != "surfaceless" && egl().QueryDevices != nullptr &&
      hasExtension(extensions, "EGL_EXT_platform_device")) {
    std::array<EGLDeviceEXT, 16> devices{};
    EGLint count = 0;
    if (egl().QueryDevices(static_cast<EGLint>(devices.size()), devices.data(), &count) !=
        EGL_TRUE) {
      count = 0;
    }
    for (int i = 0; i < count; ++i) {
      list.push_back({fmt::format("EGL device {}", i), EGL_PLATFORM_DEVICE_EXT,
                      devices[static_cast<std::size_t>(i)]});
    }
  }
  return list;
}

class EglContext final : public GlContext {
 public:
  explicit EglContext(const Candidate& candidate) : platform_(candidate.platform) {
    display_ = egl().GetPlatformDisplay(candidate.platform_enum, candidate.native, nullptr);
    EGLint major = 0;
    EGLint minor = 0;
    if (display_ == EGL_NO_DISPLAY || egl().Initialize(display_, &major, &minor) != EGL_TRUE) {
      fail("cannot be initialised");
    }
    const char* extensions = egl().QueryString(display_, EGL_EXTENSIONS);
    if (!hasExtension(extensions, "EGL_KHR_surfaceless_context")) {
      fail("has no surfaceless contexts");
    }
    createContext(hasExtension(extensions, "EGL_KHR_no_config_context"));
  }

  // The display stays initialised: other libraries of the process may use it too.
  ~EglContext() override { egl().DestroyContext(display_, context_); }

  const std::string& platform() const override { return platform_; }
  void* lookup(const char* name) const override {
    return reinterpret_cast<void*>(egl().GetProcAddress(name));
  }

  std::unique_ptr<ScopedCurrent> makeCurrent() override {
    auto current = std::make_unique<EglCurrent>();
    egl().BindAPI(EGL_OPENGL_API);
    if (egl().MakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, context_) != EGL_TRUE) {
      throw RenderError(fmt::format("{}: the context cannot be made current (EGL error {:#x})",
                                    platform_, egl().GetError()));
    }
    current->display = display_;
    return current;
  }

 private:
  struct EglCurrent final : ScopedCurrent {
    ~EglCurrent() override {
      if (display != EGL_NO_DISPLAY) {
        egl().MakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
      }
    }
    EglCurrentKeeper before;
    OsMesaCurrentKeeper osmesa_before{!before.found()};
    EGLDisplay display = EGL_NO_DISPLAY;
  };

  [[noreturn]] void fail(std::string_view what) const {
    throw RenderError(fmt::format("{} {} (EGL error {:#x})", platform_, what, egl().GetError()));
  }

  void createContext(bool no_config) {
    const EglCurrentKeeper before;  // restores the thread's client API
    if (egl().BindAPI(EGL_OPENGL_API) != EGL_TRUE) fail("has no desktop OpenGL");
    EGLConfig config = EGL_NO_CONFIG_KHR;
    if (!no_config) {
      const std::array<EGLint, 5> wanted = {EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT, EGL_SURFACE_TYPE,
                                            0, EGL_NONE};
      EGLint count = 0;
      if (egl().ChooseConfig(display_, wanted.data(), &config, 1, &count) != EGL_TRUE ||
          count < 1) {
        fail("has no configuration for OpenGL");
      }
    }
    const std::array<EGLint, 7> attributes = {EGL_CONTEXT_MAJOR_VERSION,
                                              4,
                                              EGL_CONTEXT_MINOR_VERSION,
                                              2,
                                              EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                              EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                              EGL_NONE};
    context_ = egl().CreateContext(display_, config, EGL_NO_CONTEXT, attributes.data());
    if (context_ == EGL_NO_CONTEXT) fail("has no OpenGL 4.2 core context");
  }

  std::string platform_;
  EGLDisplay display_ = EGL_NO_DISPLAY;
  ::EGLContext context_ = EGL_NO_CONTEXT;
};

}  // namespace

std::unique_ptr<GlContext> createEglContext() {
  if (!egl().problem.empty()) {
    throw RenderError(fmt::format("EGL: {} ({})", egl().problem, kMending));
  }
  std::string problems;
  for (const Candidate& candidate : candidates()) {
    try {
      return std::make_unique<EglContext>(candidate);
    } catch (const RenderError& error) {
      problems += fmt::format("{}{}", problems.empty() ? "" : "; ", error.what());
    }
  }
  if (problems.empty()) problems = "EGL has neither the surfaceless nor the device platform";
  throw RenderError(fmt::format("{} ({})", problems, kMending));
}

EglCurrentKeeper::EglCurrentKeeper() {
  if (!egl().problem.empty()) return;
  api_ = egl().QueryAPI();
  context_ = egl().GetCurrentContext();
  if (context_ == EGL_NO_CONTEXT) return;
  display_ = egl().GetCurrentDisplay();
  draw_ = egl().GetCurrentSurface(EGL_DRAW);
  read_ = egl().GetCurrentSurface(EGL_READ);
}

void EglCurrentKeeper::release() const {
  if (context_ == EGL_NO_CONTEXT) return;
  egl().MakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
}

EglCurrentKeeper::~EglCurrentKeeper() {
  if (!egl().problem.empty()) return;
  egl().BindAPI(api_);
  if (context_ != EGL_NO_CONTEXT) egl().MakeCurrent(display_, draw_, read_, context_);
}

}  // namespace sim2vr::render

// SPDX-License-Identifier: Apache-2.0
// OSMesa: Mesa's CPU driver as a plain library, for machines without EGL. Loaded on demand.
#include <GL/glcorearb.h>
#include <dlfcn.h>
#include <fmt/format.h>
#include <link.h>

#include <array>
#include <atomic>
#include <cstdlib>
#include <string>
#include <vector>

#include "gl_context.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::render {
namespace {

// From <GL/osmesa.h>, which is not installed everywhere.
using OsMesaHandle = struct osmesa_context*;
constexpr int kFormat = 0x22;
constexpr int kProfile = 0x33;
constexpr int kCoreProfile = 0x34;
constexpr int kMajorVersion = 0x36;
constexpr int kMinorVersion = 0x37;

struct OsMesaApi {
  OsMesaHandle (*CreateContextAttribs)(const int*, OsMesaHandle) = nullptr;
  void (*DestroyContext)(OsMesaHandle) = nullptr;
  unsigned char (*MakeCurrent)(OsMesaHandle, void*, GLenum, GLsizei, GLsizei) = nullptr;
  OsMesaHandle (*GetCurrentContext)() = nullptr;
  unsigned char (*GetColorBuffer)(OsMesaHandle, GLint*, GLint*, GLint*, void**) = nullptr;
  void* (*GetProcAddress)(const char*) = nullptr;
};

template <class Function>
void find(void* library, const char* name, Function& function) {
  function = reinterpret_cast<Function>(dlsym(library, name));
  if (function == nullptr) throw RenderError(fmt::format("OSMesa: the library has no {}", name));
}

/// SIM2VR_OSMESA_LIBRARY names another file than the system's.
std::vector<std::string> libraryNames() {
  if (const char* chosen = std::getenv("SIM2VR_OSMESA_LIBRARY")) return {chosen};
  return {"libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"};
}

void* openLibrary() {
  std::string problem;
  for (const std::string& name : libraryNames()) {
    if (void* library = dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL)) return library;
    if (problem.empty()) problem = dlerror();
  }
  throw RenderError(fmt::format("OSMesa: {} (install the package libosmesa6)", problem));
}

OsMesaApi findFunctions(void* library) {
  OsMesaApi api;
  find(library, "OSMesaCreateContextAttribs", api.CreateContextAttribs);
  find(library, "OSMesaDestroyContext", api.DestroyContext);
  find(library, "OSMesaMakeCurrent", api.MakeCurrent);
  find(library, "OSMesaGetCurrentContext", api.GetCurrentContext);
  find(library, "OSMesaGetColorBuffer", api.GetColorBuffer);
  find(library, "OSMesaGetProcAddress", api.GetProcAddress);
  return api;
}

/// How many libraries the process has loaded so far.
unsigned long long loadedLibraries() {
  unsigned long long count = 0;
  dl_iterate_phdr(
      [](dl_phdr_info* info, std::size_t, void* result) {
        *static_cast<unsigned long long*>(result) = info->dlpi_adds;
        return 1;
      },
      &count);
  return count;
}

/// The functions of a library that this process has loaded already, by whomever.
const OsMesaApi* loadedOsMesa() {
  static std::atomic<const OsMesaApi*> known = nullptr;
  static std::atomic<unsigned long long> searched_at = 0;
  if (const OsMesaApi* api = known.load(std::memory_order_acquire)) return api;
  // The search looks at files; it is only worth it after something new was loaded.
  const unsigned long long now = loadedLibraries();
  if (searched_at.exchange(now) == now) return nullptr;
  static const std::vector<std::string> names = libraryNames();
  for (const std::string& name : names) {
    void* library = dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NOLOAD);
    if (library == nullptr) continue;
    static const OsMesaApi api = findFunctions(library);
    known.store(&api, std::memory_order_release);
    return &api;
  }
  return nullptr;
}

class OsMesaContext final : public GlContext {
 public:
  OsMesaContext() : osmesa_(findFunctions(openLibrary())) {
    const std::array<int, 9> attributes = {
        kFormat, GL_RGBA, kProfile, kCoreProfile, kMajorVersion, 4, kMinorVersion, 2, 0};
    context_ = osmesa_.CreateContextAttribs(attributes.data(), nullptr);
    if (context_ == nullptr) throw RenderError("OSMesa: no OpenGL 4.2 core context");
  }
  ~OsMesaContext() override { osmesa_.DestroyContext(context_); }

  const std::string& platform() const override { return platform_; }
  void* lookup(const char* name) const override { return osmesa_.GetProcAddress(name); }

  std::unique_ptr<ScopedCurrent> makeCurrent() override {
    auto current = std::make_unique<OsMesaCurrent>(osmesa_);
    if (osmesa_.MakeCurrent(context_, unused_.data(), GL_UNSIGNED_BYTE, kEdge, kEdge) == 0) {
      throw RenderError("OSMesa: the context cannot be made current");
    }
    return current;
  }

 private:
  struct OsMesaCurrent final : ScopedCurrent {
    explicit OsMesaCurrent(const OsMesaApi& api) : osmesa(api) { egl_before.release(); }
    ~OsMesaCurrent() override { osmesa.MakeCurrent(nullptr, nullptr, 0, 0, 0); }
    const OsMesaApi& osmesa;
    EglCurrentKeeper egl_before;
    OsMesaCurrentKeeper before{!egl_before.found()};
  };

  static constexpr int kEdge = 4;
  std::string platform_ = "OSMesa";
  OsMesaApi osmesa_;
  OsMesaHandle context_ = nullptr;
  /// OSMesa wants a window-like buffer; pictures are drawn in a framebuffer object instead.
  std::array<unsigned char, 4 * kEdge * kEdge> unused_{};
};

}  // namespace

std::unique_ptr<GlContext> createOsMesaContext() { return std::make_unique<OsMesaContext>(); }

OsMesaCurrentKeeper::OsMesaCurrentKeeper(bool ask) {
  const OsMesaApi* osmesa = ask ? loadedOsMesa() : nullptr;
  if (osmesa == nullptr) return;
  OsMesaHandle context = osmesa->GetCurrentContext();
  if (context == nullptr) return;
  GLint format = 0;
  osmesa->GetColorBuffer(context, &width_, &height_, &format, &buffer_);
  if (buffer_ != nullptr) context_ = context;
}

OsMesaCurrentKeeper::~OsMesaCurrentKeeper() {
  if (context_ == nullptr) return;
  loadedOsMesa()->MakeCurrent(static_cast<OsMesaHandle>(context_), buffer_, GL_UNSIGNED_BYTE,
                              width_, height_);
}

}  // namespace sim2vr::render

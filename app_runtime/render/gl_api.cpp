#include "gl_api.hpp"

#include <string>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::render {
namespace {

template <class Function>
void find(const GlApi::Lookup& lookup, const char* name, Function& function) {
  function = reinterpret_cast<Function>(lookup(name));
  if (function == nullptr) {
    throw RenderError(std::string("the driver has no ") + name + " (OpenGL 4.2 is needed)");
  }
}

}  // namespace

GlApi::GlApi(const Lookup& lookup) {
#define SIM2VR_GL_FIND(type, name) find(lookup, "gl" #name, name);
  SIM2VR_GL_FUNCTIONS(SIM2VR_GL_FIND)
#undef SIM2VR_GL_FIND
}

}  // namespace sim2vr::render

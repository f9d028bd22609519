// SPDX-License-Identifier: Apache-2.0
// A preloaded library for programs on an X server without the XFree86-VidMode extension, such as
// Xvfb: where the server has no list of video modes, it gives one mode of the screen's size.
// hello_xr -g OpenGL reads the list without looking whether there is one.
#include <dlfcn.h>

#include <cstdlib>

namespace {

/// XF86VidModeModeInfo of <X11/extensions/xf86vmode.h>.
struct Mode {
  unsigned int dotclock;
  unsigned short hdisplay, hsyncstart, hsyncend, htotal, hskew;
  unsigned short vdisplay, vsyncstart, vsyncend, vtotal;
  unsigned int flags;
  int private_size;
  int* private_data;
};

struct OneMode {
  Mode* list[1];
  Mode mode;
};

template <class Function>
Function next(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

int screenSize(const char* name, void* display, int screen) {
  const auto size = next<int (*)(void*, int)>(name);
  return size != nullptr ? size(display, screen) : 0;
}

}  // namespace

extern "C" __attribute__((visibility("default"))) int XF86VidModeGetAllModeLines(void* display,
                                                                                 int screen,
                                                                                 int* count,
                                                                                 Mode*** modes) {
  using GetAll = int (*)(void*, int, int*, Mode***);
  const auto real = next<GetAll>("XF86VidModeGetAllModeLines");
  *count = 0;
  *modes = nullptr;
  if (real != nullptr && real(display, screen, count, modes) != 0 && *count > 0) return 1;
  // One block: the program frees the list by XFree, which is free().
  auto* made = static_cast<OneMode*>(std::calloc(1, sizeof(OneMode)));
  if (made == nullptr) return 0;
  Mode& mode = made->mode;
  mode.hdisplay = static_cast<unsigned short>(screenSize("XDisplayWidth", display, screen));
  mode.vdisplay = static_cast<unsigned short>(screenSize("XDisplayHeight", display, screen));
  mode.htotal = mode.hsyncend = mode.hsyncstart = mode.hdisplay;
  mode.vtotal = mode.vsyncend = mode.vsyncstart = mode.vdisplay;
  // Pixels x 60 Hz, in kHz.
  mode.dotclock = static_cast<unsigned int>(mode.htotal) * mode.vtotal * 60U / 1000U;
  made->list[0] = &mode;
  *modes = made->list;
  *count = 1;
  return 1;
}

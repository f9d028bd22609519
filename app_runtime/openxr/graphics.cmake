# What programs may draw with. Only headers are needed here: libGL, libEGL, libvulkan and libX11 are
# those of the program, opened at run time. An API whose headers are missing is left out.
function(sim2vr_openxr_graphics api packages)
  cmake_parse_arguments(ARG "" "" "HEADERS;SOURCES" ${ARGN})
  foreach(header ${ARG_HEADERS})
    string(MAKE_C_IDENTIFIER "SIM2VR_HAS_${header}" variable)
    find_path(${variable} ${header})
    if(NOT ${variable})
      message(STATUS "OpenXR runtime: without ${api}, ${header} is missing (packages ${packages})")
      return()
    endif()
    target_include_directories(sim2vr_openxr PRIVATE "${${variable}}")
  endforeach()
  target_sources(sim2vr_openxr PRIVATE ${ARG_SOURCES})
  target_compile_definitions(sim2vr_openxr PUBLIC SIM2VR_OPENXR_${api})
endfunction()

target_sources(sim2vr_openxr PRIVATE pixels.cpp gl_graphics.cpp)
sim2vr_openxr_graphics(OPENGL "libgl-dev libx11-dev" HEADERS GL/glx.h X11/Xlib.h
                       SOURCES graphics_opengl.cpp)
sim2vr_openxr_graphics(EGL "libegl-dev" HEADERS EGL/eglext.h SOURCES graphics_egl.cpp)
sim2vr_openxr_graphics(VULKAN "libvulkan-dev" HEADERS vulkan/vulkan_core.h
                       SOURCES graphics_vulkan.cpp vulkan_calls.cpp vulkan_device.cpp)

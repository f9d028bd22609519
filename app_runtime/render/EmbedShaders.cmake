# Writes shaders/* into a C++ source, so that the library needs no files at run time.
function(sim2vr_embed_shaders output)
  set(entries "")
  foreach(path ${ARGN})
    get_filename_component(name "${path}" NAME)
    file(READ "${path}" text)
    string(APPEND entries "    {\"${name}\", R\"glsl(${text})glsl\"},\n")
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${path}")
  endforeach()
  set(source "// Generated from shaders/ by EmbedShaders.cmake.
#include \"shaders.hpp\"

namespace sim2vr::render {

const std::map<std::string, std::string, std::less<>>& embeddedShaders() {
  static const std::map<std::string, std::string, std::less<>> files = {
${entries}  };
  return files;
}

}  // namespace sim2vr::render
")
  file(CONFIGURE OUTPUT "${output}" CONTENT "@source@" @ONLY)
endfunction()

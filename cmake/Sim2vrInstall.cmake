# Where things go. Two layouts:
#   wheel (scikit-build-core sets SKBUILD): everything below sim2vr_harness/
#   cmake --install: bin/sim2vr-app, share/sim2vr/{shaders,configs}, lib/sim2vr/
# The OpenXR runtime's manifest lies beside its library, and so do the libraries that programs preload.

if(SKBUILD)
  set(sim2vr_bin_dir sim2vr_harness/bin)
  set(sim2vr_share_dir sim2vr_harness/share)
  set(sim2vr_lib_dir sim2vr_harness/lib)
else()
  include(GNUInstallDirs)
  set(sim2vr_bin_dir ${CMAKE_INSTALL_BINDIR})
  set(sim2vr_share_dir ${CMAKE_INSTALL_DATADIR}/sim2vr)
  set(sim2vr_lib_dir ${CMAKE_INSTALL_LIBDIR}/sim2vr)
endif()

install(TARGETS sim2vr-app RUNTIME DESTINATION ${sim2vr_bin_dir})
install(TARGETS sim2vr_openxr_runtime sim2vr_openxr_layer sim2vr_clock sim2vr_vidmode
  LIBRARY DESTINATION ${sim2vr_lib_dir})
install(FILES app_runtime/openxr/sim2vr_openxr.json
  app_runtime/openxr/layer/sim2vr_openxr_layer.json DESTINATION ${sim2vr_lib_dir})
# All that is installed, which is what `make setup` builds.
add_custom_target(sim2vr_installed DEPENDS
  sim2vr-app sim2vr_openxr_runtime sim2vr_openxr_layer sim2vr_clock sim2vr_vidmode)
install(DIRECTORY shaders configs DESTINATION ${sim2vr_share_dir})
install(FILES packages.txt THIRD_PARTY_LICENSES.md DESTINATION ${sim2vr_share_dir})

# A CMake package for games outside the repository (docs/guide/own_game.md), in the virtual
# environment: find_package finds the one that is active.
if(SKBUILD)
  set(sim2vr_prefix "${SKBUILD_DATA_DIR}/")
endif()
foreach(module ${SIM2VR_GAME_MODULES})
  install(DIRECTORY app_runtime/${module}/include/sim2vr DESTINATION ${sim2vr_prefix}include
    COMPONENT development)
  file(GLOB_RECURSE headers "${PROJECT_SOURCE_DIR}/app_runtime/${module}/include/*.hpp")
  list(APPEND sim2vr_headers ${headers})
endforeach()
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${sim2vr_headers})
set(digests "")
foreach(header ${sim2vr_headers})
  file(SHA256 "${header}" digest)
  string(APPEND digests ${digest})
endforeach()
string(SHA256 digest "${digests}")
string(SUBSTRING ${digest} 0 12 digest)
file(CONFIGURE OUTPUT "${PROJECT_BINARY_DIR}/include/sim2vr/games/build.hpp"
  CONTENT "#pragma once\n\n#define SIM2VR_BUILD \"sim2vr ${PROJECT_VERSION}, headers ${digest}\"\n")
install(FILES "${PROJECT_BINARY_DIR}/include/sim2vr/games/build.hpp"
  DESTINATION ${sim2vr_prefix}include/sim2vr/games COMPONENT development)
include(CMakePackageConfigHelpers)
write_basic_package_version_file("${PROJECT_BINARY_DIR}/sim2vr-config-version.cmake"
  COMPATIBILITY ExactVersion)
install(FILES cmake/sim2vr-config.cmake "${PROJECT_BINARY_DIR}/sim2vr-config-version.cmake"
  DESTINATION ${sim2vr_prefix}lib/cmake/sim2vr COMPONENT development)

if(TARGET _app_runtime)
  add_dependencies(sim2vr_installed _app_runtime)
  if(SIM2VR_INPLACE)
    set_target_properties(_app_runtime PROPERTIES
      LIBRARY_OUTPUT_DIRECTORY "${PROJECT_SOURCE_DIR}/python/sim2vr_harness")
  endif()
  if(SKBUILD)
    install(TARGETS _app_runtime LIBRARY DESTINATION sim2vr_harness)
    install(FILES "$<TARGET_FILE_DIR:_app_runtime>/games.json" DESTINATION sim2vr_harness)
  endif()
endif()

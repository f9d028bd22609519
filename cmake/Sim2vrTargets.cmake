# One library per app_runtime folder. Each module exports only its own include
# directory (app_runtime/<module>/include), so the link line of a module is the
# complete list of what it may include.

add_library(sim2vr_options INTERFACE)
target_compile_options(sim2vr_options INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion
  -Wnon-virtual-dtor -Woverloaded-virtual
  # GCC 12 warns wrongly about "literal" + std::string (GCC bug 105651).
  $<$<AND:$<CXX_COMPILER_ID:GNU>,$<VERSION_LESS:$<CXX_COMPILER_VERSION>,13>>:-Wno-restrict>
  # Bit-equal results between the executable, the extension module and every
  # build preset: no fused multiply-add contraction, no fast-math.
  -ffp-contract=off)
if(CMAKE_UNITY_BUILD)
  # A private class may use what is private to its source, also where sources are joined.
  target_compile_options(sim2vr_options INTERFACE -Wno-subobject-linkage)
endif()
if(SIM2VR_WARNINGS_AS_ERRORS)
  target_compile_options(sim2vr_options INTERFACE -Werror)
endif()

# Headers of others that nearly every source includes are compiled once: with them a source takes
# three to five seconds, most of it Eigen. Sources still include what they use.
set(SIM2VR_PRECOMPILED <Eigen/Core> <Eigen/Geometry> <fmt/format.h> <nlohmann/json.hpp>
  <algorithm> <array> <cmath> <cstdint> <filesystem> <functional> <map> <memory> <optional> <span>
  <string> <string_view> <utility> <vector>)

# sim2vr_library(<name> SOURCES <files...> [DEPENDS <targets...>] [PRIVATE_DEPENDS <targets...>])
function(sim2vr_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPENDS;PRIVATE_DEPENDS" ${ARGN})
  add_library(sim2vr_${name} STATIC ${ARG_SOURCES})
  add_library(sim2vr::${name} ALIAS sim2vr_${name})
  target_include_directories(sim2vr_${name} PUBLIC "${CMAKE_CURRENT_SOURCE_DIR}/include")
  target_link_libraries(sim2vr_${name} PUBLIC ${ARG_DEPENDS}
                        PRIVATE sim2vr_options ${ARG_PRIVATE_DEPENDS})
  if(name STREQUAL core)
    target_precompile_headers(sim2vr_core PRIVATE ${SIM2VR_PRECOMPILED})
  else()
    target_precompile_headers(sim2vr_${name} REUSE_FROM sim2vr_core)
  endif()
endfunction()

# What a game is made of (cmake/Sim2vrInstall.cmake installs these modules' headers).
set(SIM2VR_GAME_MODULES core scene xr physics render rl games)

# sim2vr_serves_games(<target>): the target has every function of these modules, used by itself or
# not, and shows them to the libraries of games that it opens.
function(sim2vr_serves_games target)
  set(archives "")
  foreach(module ${SIM2VR_GAME_MODULES})
    target_link_libraries(${target} PRIVATE sim2vr_${module})
    string(APPEND archives ",$<TARGET_FILE:sim2vr_${module}>")
  endforeach()
  target_link_options(${target} PRIVATE "LINKER:--whole-archive${archives},--no-whole-archive")
  set_target_properties(${target} PROPERTIES ENABLE_EXPORTS ON)
endfunction()

# sim2vr_test(<name> SOURCES <files...> DEPENDS <targets...>): one GoogleTest executable.
function(sim2vr_test name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPENDS" ${ARGN})
  add_executable(test_${name} ${ARG_SOURCES})
  target_link_libraries(test_${name} PRIVATE ${ARG_DEPENDS} sim2vr_options
                        GTest::gtest GTest::gtest_main)
  target_include_directories(test_${name} PRIVATE "${PROJECT_SOURCE_DIR}/tests/cpp")
  target_compile_definitions(test_${name} PRIVATE
    SIM2VR_SOURCE_DIR="${PROJECT_SOURCE_DIR}"
    SIM2VR_TEST_DATA_DIR="${PROJECT_SOURCE_DIR}/tests/data")
  if(name STREQUAL core)  # the first one
    target_precompile_headers(test_core PRIVATE <gtest/gtest.h> ${SIM2VR_PRECOMPILED})
  else()
    target_precompile_headers(test_${name} REUSE_FROM test_core)
  endif()
  gtest_discover_tests(test_${name} DISCOVERY_TIMEOUT 60)
endfunction()

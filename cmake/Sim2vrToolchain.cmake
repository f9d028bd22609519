# Settings that hold for every target: compiler cache, sanitizers, no LTO.

find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM AND NOT DEFINED CMAKE_CXX_COMPILER_LAUNCHER)
  # Paths count from the sources' root, so that a copy of the sources builds from the same cache.
  set(CMAKE_CXX_COMPILER_LAUNCHER "${CMAKE_COMMAND}" -E env "CCACHE_BASEDIR=${CMAKE_SOURCE_DIR}"
      CCACHE_NOHASHDIR=1 CCACHE_SLOPPINESS=pch_defines,time_macros "${CCACHE_PROGRAM}")
  # What ccache needs to know of precompiled headers.
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    add_compile_options(-fpch-preprocess)
  endif()
endif()

# Results are compared bit for bit between the executable and the extension
# module, so both are made from the same objects: pybind11 must not switch on
# link-time optimisation for its module alone. For the same reason no preset
# uses -march=native (see docs and CMakePresets.json).
if(NOT DEFINED CMAKE_INTERPROCEDURAL_OPTIMIZATION)
  set(CMAKE_INTERPROCEDURAL_OPTIMIZATION OFF)
endif()

if(SIM2VR_SANITIZE)
  # -g1: reports name functions and lines; the rest of what debuggers read takes a third of the time.
  add_compile_options(-fsanitize=${SIM2VR_SANITIZE} -fno-omit-frame-pointer -O1 -g1)
  add_link_options(-fsanitize=${SIM2VR_SANITIZE})
  # A sanitized extension module cannot be loaded by a plain Python.
  if(SIM2VR_BUILD_BINDINGS STREQUAL "AUTO")
    set(SIM2VR_BUILD_BINDINGS OFF)
  endif()
endif()

if(SIM2VR_FUZZ)
  if(NOT CMAKE_CXX_COMPILER_ID MATCHES "Clang")
    message(FATAL_ERROR "SIM2VR_FUZZ needs clang (apt-get install clang libclang-rt-14-dev); the "
                        "compiler is ${CMAKE_CXX_COMPILER_ID}")
  endif()
  # Coverage in every module; the programs themselves link libFuzzer (tests/fuzz).
  add_compile_options(-fsanitize=fuzzer-no-link -fno-sanitize-recover=all)
endif()

# Finds Python and pybind11 for app_runtime/bindings and turns
# SIM2VR_BUILD_BINDINGS=AUTO into ON or OFF.
#
# pybind11 2.12 is the first version that speaks to NumPy 2; Debian 12 and
# Ubuntu 24.04 package older ones, so it comes from PyPI: `make setup` and
# `pip install .` bring it along.

if(NOT SIM2VR_BUILD_BINDINGS)
  return()
endif()

if(NOT SKBUILD AND NOT DEFINED Python_EXECUTABLE AND NOT DEFINED ENV{VIRTUAL_ENV}
   AND EXISTS "${PROJECT_SOURCE_DIR}/.venv/bin/python")
  set(Python_EXECUTABLE "${PROJECT_SOURCE_DIR}/.venv/bin/python" CACHE FILEPATH "Python interpreter")
endif()

find_package(Python 3.11 COMPONENTS Interpreter Development.Module QUIET)
if(Python_FOUND AND NOT DEFINED pybind11_DIR)
  execute_process(COMMAND "${Python_EXECUTABLE}" -m pybind11 --cmakedir
    OUTPUT_VARIABLE sim2vr_pybind11_dir OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET
    RESULT_VARIABLE sim2vr_pybind11_missing)
  if(NOT sim2vr_pybind11_missing)
    list(PREPEND CMAKE_PREFIX_PATH "${sim2vr_pybind11_dir}")
  endif()
endif()
if(Python_FOUND)
  set(PYBIND11_FINDPYTHON ON)
  find_package(pybind11 2.12 CONFIG QUIET)
endif()

if(Python_FOUND AND pybind11_FOUND)
  message(STATUS "Python extension module: for ${Python_EXECUTABLE} with pybind11 ${pybind11_VERSION}")
  set(SIM2VR_BUILD_BINDINGS ON)
else()
  if(NOT Python_FOUND)
    set(sim2vr_python_problem "no Python >= 3.11 with its headers (apt-get install python3-dev)")
  else()
    set(sim2vr_python_problem
        "no pybind11 >= 2.12 for ${Python_EXECUTABLE} (${Python_EXECUTABLE} -m pip install pybind11)")
  endif()
  if(SIM2VR_BUILD_BINDINGS STREQUAL "AUTO" AND NOT SKBUILD)
    message(STATUS "Python extension module: skipped, ${sim2vr_python_problem}")
    set(SIM2VR_BUILD_BINDINGS OFF)
  else()
    message(FATAL_ERROR "The Python extension module was asked for, but there is ${sim2vr_python_problem}. "
                        "Or configure with -DSIM2VR_BUILD_BINDINGS=OFF.")
  endif()
endif()

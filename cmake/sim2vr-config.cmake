# find_package(sim2vr): what a library of games is made with.
#
#   add_library(mygame MODULE mygame.cpp)
#   target_link_libraries(mygame PRIVATE sim2vr::game)
#
# It links nothing of sim2vr: sim2vr-app and the harness bring the code along that its headers declare.
include(CMakeFindDependencyMacro)
find_dependency(Eigen3 3.3 NO_MODULE)
find_dependency(nlohmann_json)
find_dependency(spdlog)
find_path(SIM2VR_OPENXR_INCLUDE_DIR openxr/openxr.h)
if(NOT SIM2VR_OPENXR_INCLUDE_DIR)
  set(sim2vr_FOUND FALSE)
  set(sim2vr_NOT_FOUND_MESSAGE "openxr/openxr.h was not found; install libopenxr-dev")
  return()
endif()

if(NOT TARGET sim2vr::game)
  add_library(sim2vr::game INTERFACE IMPORTED)
  get_filename_component(sim2vr_include "${CMAKE_CURRENT_LIST_DIR}/../../../include" ABSOLUTE)
  target_include_directories(sim2vr::game SYSTEM INTERFACE
    "${sim2vr_include}" "${SIM2VR_OPENXR_INCLUDE_DIR}")
  target_link_libraries(sim2vr::game INTERFACE
    Eigen3::Eigen nlohmann_json::nlohmann_json spdlog::spdlog)
  target_compile_features(sim2vr::game INTERFACE cxx_std_20)
  # Results are the same bits wherever a game is built; names that two games share stay apart.
  target_compile_options(sim2vr::game INTERFACE -ffp-contract=off -fvisibility=hidden)
endif()

// SPDX-License-Identifier: Apache-2.0
// What a game outside the repository includes: with SIM2VR_GAMES a shared library says which games
// it has (docs/guide/own_game.md). sim2vr-app and the harness open it with --game-library.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "sim2vr/games/build.hpp"
#include "sim2vr/rl/game.hpp"

#define SIM2VR_TEXT_OF(value) #value
#define SIM2VR_TEXT(value) SIM2VR_TEXT_OF(value)

namespace sim2vr::games {

/// What library and runtime must have in common, because objects of C++ pass between them: the
/// version, the headers' digest, and how the compiler lays out strings and Eigen's types.
inline constexpr const char* kBuild =
    SIM2VR_BUILD ", std::string " SIM2VR_TEXT(_GLIBCXX_USE_CXX11_ABI) ", Eigen " SIM2VR_TEXT(
        EIGEN_WORLD_VERSION) "." SIM2VR_TEXT(EIGEN_MAJOR_VERSION) " aligned to " SIM2VR_TEXT(EIGEN_MAX_STATIC_ALIGN_BYTES);

/// Registry entries of game classes.
template <class... Games>
std::vector<rl::GameEntry> entriesOf() {
  return {
      rl::GameEntry{std::string(Games().name()), std::string(Games().description()),
                    []() -> std::unique_ptr<rl::Game> { return std::make_unique<Games>(); }}...};
}

}  // namespace sim2vr::games

/// Once in a library, outside namespaces: the classes of its games.
#define SIM2VR_GAMES(...)                                                       \
  extern "C" __attribute__((visibility("default"))) const char* sim2vrBuild() { \
    return sim2vr::games::kBuild;                                               \
  }                                                                             \
  extern "C" __attribute__((visibility("default"))) void sim2vrGames(           \
      std::vector<sim2vr::rl::GameEntry>& games) {                              \
    games = sim2vr::games::entriesOf<__VA_ARGS__>();                            \
  }

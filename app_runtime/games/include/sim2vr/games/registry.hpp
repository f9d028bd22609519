// SPDX-License-Identifier: Apache-2.0
// Every game that the runtime can play.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/rl/game.hpp"

namespace sim2vr::games {

/// The games in the order in which they are listed to people.
std::vector<rl::GameEntry> registry();

/// Opens a shared library (library.hpp) and adds its games to the registry for as long as the
/// process lives; returns their names. Opening it runs its code. A library that is loaded already
/// stays as it is. Throws InvalidArgument ("game_library") for one that cannot be opened, was built
/// against another version, or brings a game of a known name.
std::vector<std::string> loadGameLibrary(const std::filesystem::path& file);

/// A new game. Throws InvalidArgument ("game") with the known names and the nearest one.
std::unique_ptr<rl::Game> createGame(std::string_view name);

/// What the game publishes, as a JSON object (rl/game_facts.hpp). Throws as createGame.
std::string gameFactsJson(std::string_view name);

/// The game's options, as a JSON array (Options::describe). Throws as createGame.
std::string gameOptionsJson(std::string_view name);

/// What comes when in a round (rl::Game::timelineJson). Throws as createGame, InvalidArgument for
/// options that the game refuses, and "game" for one without timelines.
std::string gameTimelineJson(std::string_view name, std::string_view options_json,
                             std::uint32_t seed);

}  // namespace sim2vr::games

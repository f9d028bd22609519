// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/games/registry.hpp"

#include <dlfcn.h>

#include <algorithm>
#include <map>
#include <mutex>

#include "beats/game.hpp"
#include "panel/game.hpp"
#include "pointing/game.hpp"
#include "sample/sample.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/text.hpp"
#include "sim2vr/games/library.hpp"
#include "whacamole/game.hpp"

namespace sim2vr::games {
namespace {

struct Registry {
  std::mutex mutex;
  std::vector<rl::GameEntry> games =
      entriesOf<whacamole::WhacAMole, beats::Beats, pointing::Pointing, panel::Panel,
                sample::TouchTheBall>();
  /// Libraries that were loaded, by where their paths lead: the names of their games.
  std::map<std::filesystem::path, std::vector<std::string>> libraries;
};

/// Lives as long as the process: apps of other threads may still play when statics are destroyed.
Registry& theRegistry() {
  static auto* const registry = new Registry;
  return *registry;
}

InvalidArgument refusedLibrary(const std::string& file, const std::string& problem) {
  return {"game_library", "'" + printable(file) + "', " + problem,
          std::string("a shared library with SIM2VR_GAMES that was built against this version (") +
              kBuild + "); build it again"};
}

/// Libraries of games use the runtime's functions that this program, or this module of Python's,
/// has; Python's modules keep theirs to themselves otherwise.
void offerSymbols() {
  Dl_info self{};
  if (::dladdr(reinterpret_cast<const void*>(&theRegistry), &self) == 0) return;
  ::dlopen(self.dli_fname, RTLD_NOW | RTLD_NOLOAD | RTLD_GLOBAL);
}

/// The games of a library, which stays open: their code is in it.
std::vector<rl::GameEntry> gamesIn(const std::string& file) {
  offerSymbols();
  void* const library = ::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) {
    throw refusedLibrary(file, std::string("which cannot be opened (") + ::dlerror() + ")");
  }
  const auto build = reinterpret_cast<const char* (*)()>(::dlsym(library, "sim2vrBuild"));
  const auto games =
      reinterpret_cast<void (*)(std::vector<rl::GameEntry>&)>(::dlsym(library, "sim2vrGames"));
  if (build == nullptr || games == nullptr) throw refusedLibrary(file, "a library without games");
  if (std::string_view(build()) != kBuild) {
    throw refusedLibrary(file, std::string("which was built against ") + build());
  }
  std::vector<rl::GameEntry> found;
  games(found);
  return found;
}

}  // namespace

std::vector<rl::GameEntry> registry() {
  Registry& all = theRegistry();
  const std::lock_guard<std::mutex> lock(all.mutex);
  return all.games;
}

std::vector<std::string> loadGameLibrary(const std::filesystem::path& file) {
  std::error_code problem;
  const std::filesystem::path real = std::filesystem::canonical(file, problem);
  if (problem) {
    throw InvalidArgument("game_library",
                          "'" + printable(file.native()) + "' (" + problem.message() + ")",
                          "a shared library of games");
  }
  Registry& all = theRegistry();
  const std::lock_guard<std::mutex> lock(all.mutex);
  if (const auto known = all.libraries.find(real); known != all.libraries.end()) {
    return known->second;
  }
  const std::vector<rl::GameEntry> added = gamesIn(real.native());
  std::vector<rl::GameEntry> games = all.games;
  std::vector<std::string> names;
  for (const rl::GameEntry& game : added) {
    if (std::ranges::find(games, game.name, &rl::GameEntry::name) != games.end()) {
      throw InvalidArgument("game_library",
                            "'" + printable(real.native()) + "' with a game '" + game.name +
                                "', a name that is taken",
                            "another name (Game::name)");
    }
    games.push_back(game);
    names.push_back(game.name);
  }
  all.games = games;
  return all.libraries[real] = names;
}

std::unique_ptr<rl::Game> createGame(std::string_view name) {
  std::vector<std::string> known;
  for (const rl::GameEntry& game : registry()) {
    if (game.name == name) return game.create();
    known.push_back(game.name);
  }
  throw InvalidArgument("game", std::string("'").append(name) + "'", oneOf(known, name));
}

std::string gameFactsJson(std::string_view name) {
  const std::unique_ptr<rl::Game> game = createGame(name);
  return rl::factsJson(game->name(), game->description(), game->facts());
}

std::string gameOptionsJson(std::string_view name) {
  Options options;
  createGame(name)->configure(options);
  return options.describe();
}

std::string gameTimelineJson(std::string_view name, std::string_view options_json,
                             std::uint32_t seed) {
  const std::unique_ptr<rl::Game> game = createGame(name);
  Options options = Options::fromJson(options_json);
  game->configure(options);
  options.expectAllRead();
  std::string timeline = game->timelineJson(seed);
  if (timeline.empty()) {
    throw InvalidArgument("game", "'" + std::string(name) + "'", "a game with levels");
  }
  return timeline;
}

}  // namespace sim2vr::games

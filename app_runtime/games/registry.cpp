#include "sim2vr/games/registry.hpp"

#include <array>
#include <string>
#include <vector>

#include "beats/game.hpp"
#include "panel/game.hpp"
#include "pointing/game.hpp"
#include "sample/sample.hpp"
#include "sim2vr/core/errors.hpp"
#include "whacamole/game.hpp"

namespace sim2vr::games {
namespace {

template <class T>
std::unique_ptr<rl::Game> create() {
  return std::make_unique<T>();
}

template <class T>
rl::GameEntry entry() {
  const T game;
  return {std::string(game.name()), std::string(game.description()), &create<T>};
}

}  // namespace

std::span<const rl::GameEntry> registry() {
  static const std::array entries{
      entry<whacamole::WhacAMole>(), entry<beats::Beats>(),         entry<pointing::Pointing>(),
      entry<panel::Panel>(),         entry<sample::TouchTheBall>(),
  };
  return entries;
}

std::unique_ptr<rl::Game> createGame(std::string_view name) {
  std::vector<std::string> known;
  for (const rl::GameEntry& game : registry()) {
    if (game.name == name) return game.create();
    known.push_back(game.name);
  }
  throw InvalidArgument("game", "'" + std::string(name) + "'", oneOf(known, name));
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

#include "games_binding.hpp"

#include <pybind11/stl.h>

#include <map>
#include <string>

#include "sim2vr/games/registry.hpp"

namespace py = pybind11;

namespace sim2vr::bindings {
namespace {

std::map<std::string, std::string> listGames() {
  std::map<std::string, std::string> found;
  for (const auto& entry : games::registry()) found[entry.name] = entry.description;
  return found;
}

}  // namespace

void bindGames(py::module_& module) {
  module.def("list_games", &listGames, "Names of the games with their descriptions.");
  module.def(
      "game_facts", [](const std::string& name) { return games::gameFactsJson(name); },
      py::arg("name"), "What a game publishes, as a JSON object: measures, conditions.");
}

}  // namespace sim2vr::bindings

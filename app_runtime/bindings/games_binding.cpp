#include "games_binding.hpp"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <cstdint>
#include <filesystem>
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
      "load_game_library",
      [](const std::filesystem::path& file) { return games::loadGameLibrary(file); },
      py::arg("file"),
      "Opens a shared library and adds its games; returns their names. Opening runs its code.");
  module.def(
      "game_facts", [](const std::string& name) { return games::gameFactsJson(name); },
      py::arg("name"), "What a game publishes, as a JSON object: measures, conditions.");
  module.def(
      "game_options", [](const std::string& name) { return games::gameOptionsJson(name); },
      py::arg("name"), "A game's options as a JSON array: name, type, default, range.");
  module.def(
      "game_timeline",
      [](const std::string& name, const std::string& options, std::uint32_t seed) {
        return games::gameTimelineJson(name, options, seed);
      },
      py::arg("name"), py::arg("options"), py::arg("seed"),
      "What comes when in a round of these options (a JSON object), as a JSON object.");
}

}  // namespace sim2vr::bindings

// SPDX-License-Identifier: Apache-2.0
// The extension module: the one place where C++ errors become Python's.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <exception>
#include <filesystem>
#include <map>
#include <string>
#include <utility>

#include "batch_binding.hpp"
#include "sim2vr/core/clock.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/core/text.hpp"
#include "sim2vr/core/version.hpp"
#include "sim2vr/games/registry.hpp"
#include "sim2vr/render/renderer.hpp"
#include "sim2vr/runtime/lockstep_app.hpp"

namespace py = pybind11;

namespace {

std::string glRenderer(const std::string& kind) {
  return sim2vr::render::Renderer::create(sim2vr::render::rendererKindFromName(kind))
      ->description();
}

std::map<std::string, std::string> listGames() {
  std::map<std::string, std::string> found;
  for (const auto& entry : sim2vr::games::registry()) found[entry.name] = entry.description;
  return found;
}

/// Makes Python's class of a C++ error. Messages name files, whose names are bytes of any kind:
/// pybind11's own translators lose every message that is not UTF-8.
template <class Error>
void registerError(py::module_& module, const char* name, PyObject* base) {
  static PyObject* kind = nullptr;
  kind = py::exception<Error>(module, name, base).release().ptr();
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      std::rethrow_exception(std::move(thrown));
    } catch (const Error& error) {
      PyErr_SetString(kind, sim2vr::validUtf8(error.what()).c_str());
    }
  });
}

}  // namespace

PYBIND11_MODULE(_app_runtime, module) {
  module.doc() = "The sim2vr app runtime: headless VR apps in lockstep, in this process.";
  module.attr("__version__") = std::string(sim2vr::version());

  // Later registrations are tried first, so the family goes from general to special.
  registerError<std::filesystem::filesystem_error>(module, "FileError", PyExc_RuntimeError);
  registerError<sim2vr::EngineError>(module, "EngineError", PyExc_RuntimeError);
  PyObject* const engine_error = module.attr("EngineError").ptr();
  registerError<sim2vr::StateError>(module, "StateError", engine_error);
  registerError<sim2vr::runtime::Unsupported>(module, "Unsupported", engine_error);
  registerError<sim2vr::RenderError>(module, "RenderError", engine_error);
  registerError<sim2vr::InvalidArgument>(module, "InvalidArgument", PyExc_ValueError);

  module.def("gl_renderer", &glRenderer, py::arg("kind") = "automatic",
             "Starts a renderer ('automatic', 'egl', 'osmesa', 'null') and returns its "
             "description. RenderError says what was tried.");
  module.def("frame_time_ns", py::vectorize(sim2vr::lockstepFrameTimeNs), py::arg("frame"),
             py::arg("frame_rate_hz"),
             "Times of frames in lockstep, ns: n times the largest binary32 below the period.");
  module.def(
      "set_log_level", [](const std::string& level) { sim2vr::setLogLevel(level); },
      py::arg("level"), "'trace', 'debug', 'info', 'warning' (default), 'error' or 'off'.");
  module.def("list_games", &listGames, "Names of the games with their descriptions.");
  module.def(
      "load_game_library",
      [](const std::filesystem::path& file) { return sim2vr::games::loadGameLibrary(file); },
      py::arg("file"),
      "Opens a shared library and adds its games; returns their names. Opening runs its code.");
  module.def(
      "game_facts", [](const std::string& name) { return sim2vr::games::gameFactsJson(name); },
      py::arg("name"), "What a game publishes, as a JSON object: measures, conditions.");
  module.def(
      "game_options", [](const std::string& name) { return sim2vr::games::gameOptionsJson(name); },
      py::arg("name"), "A game's options as a JSON array: name, type, default, range.");
  module.def(
      "game_timeline",
      [](const std::string& name, const std::string& options, std::uint32_t seed) {
        return sim2vr::games::gameTimelineJson(name, options, seed);
      },
      py::arg("name"), py::arg("options"), py::arg("seed"),
      "What comes when in a round of these options (a JSON object), as a JSON object.");
  sim2vr::bindings::bindAppBatch(module);
}

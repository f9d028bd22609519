#include "app_binding.hpp"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <array>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/runtime/app.hpp"
#include "sim2vr/xr/pose_row.hpp"

namespace py = pybind11;

namespace sim2vr::bindings {
namespace {

using PoseRow = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Times = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>;
using StepTuple = std::tuple<float, bool, float, std::map<std::string, double>>;

void checkRow(const char* name, const PoseRow* row) {
  if (row == nullptr || (row->ndim() == 1 && row->shape(0) == 7)) return;
  throw InvalidArgument(name, "an array of " + std::to_string(row->size()) + " numbers",
                        "7 numbers: position x y z, rotation x y z w");
}

void checkRows(const char* name, const PoseRow* rows, py::ssize_t count) {
  if (rows == nullptr) return;
  if (rows->ndim() == 2 && rows->shape(0) == count && rows->shape(1) == 7) return;
  throw InvalidArgument(name, "an array of " + std::to_string(rows->size()) + " numbers",
                        "shape (" + std::to_string(count) +
                            ", 7), one row of position x y z, rotation x y z w per frame");
}

/// One renderer of each kind serves every app of the process: contexts are costly, and their
/// drawing takes turns anyway under the GIL-free lock of the renderer.
std::shared_ptr<render::Renderer> sharedRenderer(const std::string& kind) {
  static std::mutex mutex;
  static std::map<std::string, std::weak_ptr<render::Renderer>> renderers;
  const std::lock_guard<std::mutex> lock(mutex);
  std::shared_ptr<render::Renderer> renderer = renderers[kind].lock();
  if (renderer == nullptr) {
    renderer = render::Renderer::create(render::rendererKindFromName(kind));
    renderers[kind] = renderer;
  }
  return renderer;
}

/// The Python face of runtime::App. Holds the app until close(); the image's memory lives as long
/// as any array over it, also after close().
class PyApp {
 public:
  PyApp(const std::string& game, const std::string& options, int width, int height,
        const std::string& renderer, const std::string& log_dir, double fixed_delta_time_s,
        double maximum_delta_time_s, double fixed_step_tolerance_s) {
    runtime::AppSettings settings;
    settings.game = game;
    settings.options_json = options;
    settings.headset_size = {width, height};
    settings.log_dir = log_dir;
    settings.time.fixed_delta_time_s = fixed_delta_time_s;
    settings.time.maximum_delta_time_s = maximum_delta_time_s;
    settings.time.fixed_step_tolerance_s = fixed_step_tolerance_s;
    render::checkImageSize(settings.headset_size);
    const py::gil_scoped_release release;
    app_ = std::make_shared<runtime::App>(std::move(settings), sharedRenderer(renderer));
  }

  runtime::App& app() const {
    if (app_ == nullptr) throw StateError("the app is closed; make a new one");
    return *app_;
  }

  StepTuple reset(std::uint32_t seed, const std::string& options, const PoseRow& head,
                  const std::optional<PoseRow>& left, const std::optional<PoseRow>& right,
                  std::int64_t time_ns) {
    const xr::DeviceState devices = deviceState(head, left, right);
    const py::gil_scoped_release release;
    return toTuple(app().reset({seed, options, time_ns}, devices));
  }

  StepTuple step(std::int64_t time_ns, const PoseRow& head, const std::optional<PoseRow>& left,
                 const std::optional<PoseRow>& right) {
    const runtime::FrameInput frame{time_ns, deviceState(head, left, right)};
    const py::gil_scoped_release release;
    return toTuple(app().step(frame));
  }

  StepTuple stepFrames(const Times& times_ns, const PoseRow& head,
                       const std::optional<PoseRow>& left, const std::optional<PoseRow>& right) {
    if (times_ns.ndim() != 1) {
      throw InvalidArgument("times_ns", std::to_string(times_ns.ndim()) + " dimensions", "one");
    }
    const py::ssize_t count = times_ns.shape(0);
    checkRows("head", &head, count);
    checkRows("left_controller", left ? &*left : nullptr, count);
    checkRows("right_controller", right ? &*right : nullptr, count);
    std::vector<runtime::FrameInput> frames;
    frames.reserve(static_cast<std::size_t>(count));
    const auto row = [](const std::optional<PoseRow>& rows, py::ssize_t i) {
      return rows ? rows->data(i, 0) : nullptr;
    };
    for (py::ssize_t i = 0; i < count; ++i) {
      frames.push_back({times_ns.at(i), xr::devicesFromRows(head.data(i, 0), row(left, i),
                                                            row(right, i), inputs_)});
    }
    const py::gil_scoped_release release;
    return toTuple(app().step(frames));
  }

  void setButtons(const std::string& hand, float trigger, float squeeze,
                  std::pair<float, float> thumbstick, bool lower, bool upper, bool menu) {
    if (hand != "left" && hand != "right") {
      throw InvalidArgument("hand", "'" + hand + "'", "'left' or 'right'");
    }
    xr::ControllerState state;
    state.trigger = trigger;
    state.squeeze = squeeze;
    state.thumbstick = {thumbstick.first, thumbstick.second};
    state.menu = menu;
    (hand == "left" ? state.x : state.a) = lower;
    (hand == "left" ? state.y : state.b) = upper;
    inputs_[static_cast<std::size_t>(hand == "left" ? xr::Hand::left : xr::Hand::right)] = state;
  }

  py::array_t<std::uint8_t> image() {
    const auto bytes = app().image();
    const auto [width, height] = app().settings().headset_size;
    // The array's base keeps the app, and with it the buffer, alive.
    auto* owner = new std::shared_ptr<runtime::App>(app_);
    const py::capsule base(
        owner, [](void* kept) { delete static_cast<std::shared_ptr<runtime::App>*>(kept); });
    py::array_t<std::uint8_t> view({height, width, 4}, bytes.data(), base);
    view.attr("flags").attr("writeable") = false;
    return view;
  }

  py::array_t<std::uint8_t> renderView(const std::string& view, int width, int height) {
    const render::ImageSize size{width, height};
    render::checkImageSize(size);
    py::array_t<std::uint8_t> image({height, width, 4});
    const std::span<std::uint8_t> rgba(image.mutable_data(), size.pixels() * 4);
    const py::gil_scoped_release release;
    app().renderView(runtime::viewFromName(view), size, rgba);
    return image;
  }

  py::bytes save() {
    std::string state;
    {
      const py::gil_scoped_release release;
      state = app().save();
    }
    return py::bytes(state);
  }

  void load(const py::bytes& state) {
    const std::string saved = state;
    const py::gil_scoped_release release;
    app().load(saved);
  }

  std::uint64_t stateHash() {
    const py::gil_scoped_release release;
    return app().stateHash();
  }

  std::vector<std::string> capabilities() const {
    return runtime::capabilityNames(app().capabilities());
  }
  std::string rendererDescription() const { return app().rendererDescription(); }

  void close() { app_.reset(); }

 private:
  static StepTuple toTuple(runtime::StepResult&& result) {
    return {result.reward, result.finished, result.time_feature, std::move(result.log)};
  }

  xr::DeviceState deviceState(const PoseRow& head, const std::optional<PoseRow>& left,
                              const std::optional<PoseRow>& right) const {
    checkRow("head", &head);
    checkRow("left_controller", left ? &*left : nullptr);
    checkRow("right_controller", right ? &*right : nullptr);
    return xr::devicesFromRows(head.data(), left ? left->data() : nullptr,
                               right ? right->data() : nullptr, inputs_);
  }

  std::shared_ptr<runtime::App> app_;
  /// Analogue and digital inputs by hand, which stay until they are set again.
  std::array<xr::ControllerState, 2> inputs_;
};

}  // namespace

void bindApp(py::module_& module) {
  py::class_<PyApp>(module, "App",
                    "One VR app in lockstep. Poses are arrays of 7 float64: position x y z (m), "
                    "rotation x y z w, app frame (left-handed, y up, z forward). The GIL is "
                    "released while the app works; one App must not be used from two threads at "
                    "once, different Apps may.")
      .def(py::init<const std::string&, const std::string&, int, int, const std::string&,
                    const std::string&, double, double, double>(),
           py::kw_only(), py::arg("game"), py::arg("options") = "{}", py::arg("width") = 120,
           py::arg("height") = 80, py::arg("renderer") = "automatic", py::arg("log_dir") = "",
           py::arg("fixed_delta_time_s") = TimeSettings{}.fixed_delta_time_s,
           py::arg("maximum_delta_time_s") = TimeSettings{}.maximum_delta_time_s,
           py::arg("fixed_step_tolerance_s") = TimeSettings{}.fixed_step_tolerance_s,
           "options: JSON object. log_dir: root of the episode logs, '' for none. The times are "
           "those of TimeSettings in core/clock.hpp.")
      .def("reset", &PyApp::reset, py::arg("seed"), py::arg("options"), py::arg("head"),
           py::arg("left_controller") = py::none(), py::arg("right_controller") = py::none(),
           py::arg("time_ns") = 0,
           "Starts a round with its first frame at time_ns; returns (reward, finished, time "
           "feature, log).")
      .def("step", &PyApp::step, py::arg("time_ns"), py::arg("head"),
           py::arg("left_controller") = py::none(), py::arg("right_controller") = py::none(),
           "Runs one frame; returns (reward, finished, time feature, log).")
      .def("step_frames", &PyApp::stepFrames, py::arg("times_ns"), py::arg("head"),
           py::arg("left_controller") = py::none(), py::arg("right_controller") = py::none(),
           "One user step of K frames, the last one rendered: times_ns (K,) int64, poses (K, 7); "
           "returns (summed reward, finished, time feature, log).")
      .def("set_buttons", &PyApp::setButtons, py::arg("hand"), py::arg("trigger") = 0.0F,
           py::arg("squeeze") = 0.0F, py::arg("thumbstick") = std::pair<float, float>(0.0F, 0.0F),
           py::arg("lower") = false, py::arg("upper") = false, py::arg("menu") = false,
           "Inputs of the hand 'left' (lower X, upper Y) or 'right' (lower A, upper B) from the "
           "next frame on.")
      .def_property_readonly(
          "image", &PyApp::image,
          "(height, width, 4) uint8 RGBA headset image of the last frame, row 0 = top, alpha = "
          "linear depth / far plane. A read-only view of the app's buffer without a copy: it is "
          "overwritten by reset, step and load, and stays valid memory after close().")
      .def("render_view", &PyApp::renderView, py::arg("view"), py::arg("width"), py::arg("height"),
           "The last frame from 'headset', 'recorder' or 'spectator', (height, width, 4) uint8.")
      .def("save", &PyApp::save, "The whole app state as bytes, mid-round included.")
      .def("load", &PyApp::load, py::arg("state"),
           "Goes on from saved bytes; EngineError for damaged or foreign ones.")
      .def("state_hash", &PyApp::stateHash, "64-bit hash of what save() would return.")
      .def_property_readonly("capabilities", &PyApp::capabilities, "Names of what it can do.")
      .def_property_readonly("renderer_description", &PyApp::rendererDescription)
      .def("close", &PyApp::close, "Frees the app; later calls raise StateError.");
}

}  // namespace sim2vr::bindings

#include "batch_binding.hpp"

#include <fmt/format.h>
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/runtime/app_batch.hpp"
#include "sim2vr/xr/pose_row.hpp"

namespace py = pybind11;

namespace sim2vr::bindings {
namespace {

template <class T>
using Array = py::array_t<T, py::array::c_style | py::array::forcecast>;
using Poses = Array<double>;
using OptionalPoses = std::optional<Poses>;

template <class T>
void checkShape(const char* name, const Array<T>& array, const std::vector<py::ssize_t>& shape) {
  const std::vector<py::ssize_t> got(array.shape(), array.shape() + array.ndim());
  if (got == shape) return;
  throw InvalidArgument(name, fmt::format("shape ({})", fmt::join(got, ", ")),
                        fmt::format("shape ({})", fmt::join(shape, ", ")));
}

/// Poses of M apps with K frames each: (M, K, 7) per device, a device that is not tracked missing.
class DeviceRows {
 public:
  DeviceRows(const Poses& head, const OptionalPoses& left, const OptionalPoses& right,
             const std::vector<py::ssize_t>& shape)
      : head_(head.data()),
        left_(left ? left->data() : nullptr),
        right_(right ? right->data() : nullptr) {
    checkShape("head", head, shape);
    if (left) checkShape("left_controller", *left, shape);
    if (right) checkShape("right_controller", *right, shape);
  }

  xr::DeviceState operator[](py::ssize_t i) const {
    const auto row = [i](const double* rows) {
      return rows == nullptr ? nullptr : rows + i * xr::kPoseRowNumbers;
    };
    return xr::devicesFromRows(row(head_), row(left_), row(right_));
  }

 private:
  const double* head_;
  const double* left_;
  const double* right_;
};

/// The Python face of runtime::AppBatch. Its arrays are views that keep the batch alive.
class PyAppBatch {
 public:
  PyAppBatch(const std::string& game, const std::string& options, int apps, int threads, int width,
             int height, const std::string& renderer, const std::string& log_dir,
             double fixed_delta_time_s, const std::vector<int>& vision_channels) {
    runtime::BatchSettings settings;
    settings.app.game = game;
    settings.app.options_json = options;
    settings.app.headset_size = {width, height};
    settings.app.log_dir = log_dir;
    settings.app.time.fixed_delta_time_s = fixed_delta_time_s;
    settings.apps = apps;
    settings.threads = threads;
    settings.renderer = render::rendererKindFromName(renderer);
    settings.vision_channels = vision_channels;
    const py::gil_scoped_release release;
    batch_ = std::make_shared<runtime::AppBatch>(settings);
  }

  runtime::AppBatch& batch() const {
    if (batch_ == nullptr) throw StateError("the apps are closed; make new ones");
    return *batch_;
  }

  void reset(const Array<int>& indices, const Array<std::uint32_t>& seeds,
             const std::string& options, const Poses& head, const OptionalPoses& left,
             const OptionalPoses& right, std::int64_t time_ns) {
    const py::ssize_t count = indices.size();
    checkShape("seeds", seeds, {count});
    const DeviceRows rows(head, left, right, {count, xr::kPoseRowNumbers});
    std::vector<runtime::RoundStart> starts;
    std::vector<xr::DeviceState> devices;
    for (py::ssize_t i = 0; i < count; ++i) {
      starts.push_back({seeds.at(i), options, time_ns});
      devices.push_back(rows[i]);
    }
    const std::span<const int> apps(indices.data(), static_cast<std::size_t>(count));
    const py::gil_scoped_release release;
    batch().reset(apps, starts, devices);
  }

  void step(const Array<int>& indices, const Array<std::int64_t>& times_ns, const Poses& head,
            const OptionalPoses& left, const OptionalPoses& right) {
    const py::ssize_t count = indices.size();
    if (times_ns.ndim() != 2) {
      throw InvalidArgument("times_ns", std::to_string(times_ns.ndim()) + " dimensions",
                            "2: apps and frames");
    }
    checkShape("times_ns", times_ns, {count, times_ns.shape(1)});
    const DeviceRows rows(head, left, right, {count, times_ns.shape(1), xr::kPoseRowNumbers});
    frames_.clear();
    for (py::ssize_t i = 0; i < times_ns.size(); ++i) {
      frames_.push_back({times_ns.data()[i], rows[i]});
    }
    const std::span<const int> apps(indices.data(), static_cast<std::size_t>(count));
    const py::gil_scoped_release release;
    batch().step(apps, frames_);
  }

  template <class T>
  py::array_t<T> view(std::span<const T> values, std::vector<py::ssize_t> shape) const {
    auto* owner = new std::shared_ptr<runtime::AppBatch>(batch_);
    const py::capsule base(
        owner, [](void* kept) { delete static_cast<std::shared_ptr<runtime::AppBatch>*>(kept); });
    py::array_t<T> array(std::move(shape), values.data(), base);
    array.attr("flags").attr("writeable") = false;
    return array;
  }

  py::array_t<std::uint8_t> images() const {
    const auto [width, height] = batch().settings().app.headset_size;
    return view(batch().images(), {batch().size(), height, width, 4});
  }
  py::array_t<std::uint8_t> vision() const {
    const auto [width, height] = batch().settings().app.headset_size;
    const auto channels = static_cast<py::ssize_t>(batch().settings().vision_channels.size());
    return view(batch().vision(), {batch().size(), channels, height, width});
  }
  py::array_t<float> rewards() const { return view(batch().rewards(), {batch().size()}); }
  py::array_t<std::uint8_t> finished() const { return view(batch().finished(), {batch().size()}); }
  py::array_t<float> timeFeatures() const { return view(batch().timeFeatures(), {batch().size()}); }
  std::vector<std::string> logNames() const { return batch().logNames(); }
  std::vector<std::string> privilegedNames() const { return batch().privilegedNames(); }
  py::array_t<float> privileged() const {
    return view(batch().privileged(),
                {batch().size(), static_cast<py::ssize_t>(batch().privilegedNames().size())});
  }
  py::array_t<double> logs() const {
    return view(batch().logs(),
                {batch().size(), static_cast<py::ssize_t>(batch().logNames().size())});
  }

  py::array_t<std::uint8_t> renderView(int app, const std::string& view, int width, int height) {
    const render::ImageSize size{width, height};
    render::checkImageSize(size);
    py::array_t<std::uint8_t> image({height, width, 4});
    const std::span<std::uint8_t> rgba(image.mutable_data(), size.pixels() * 4);
    const py::gil_scoped_release release;
    batch().app(app).renderView(runtime::viewFromName(view), size, rgba);
    return image;
  }

  py::bytes save(int app) const { return py::bytes(batch().app(app).save()); }
  void load(int app, const py::bytes& state) { batch().load(app, std::string(state)); }
  std::uint64_t stateHash(int app) const { return batch().app(app).stateHash(); }
  std::vector<std::string> capabilities() const {
    return runtime::capabilityNames(batch().app(0).capabilities());
  }
  std::string rendererDescription() const { return batch().app(0).rendererDescription(); }
  int threads() const { return batch().threads(); }
  void close() {
    // Arrays that are still held keep the batch's memory, but not its apps.
    if (batch_ != nullptr) batch_->close();
    batch_.reset();
  }

 private:
  std::shared_ptr<runtime::AppBatch> batch_;
  std::vector<runtime::FrameInput> frames_;
};

}  // namespace

void bindAppBatch(py::module_& module) {
  py::class_<PyAppBatch>(
      module, "AppBatch",
      "N apps of one game, stepped together on threads. Poses are float64 rows of 7 as of App; M "
      "apps "
      "are chosen by their indices. Arrays of results are read-only views without copies: calls "
      "overwrite the rows of the apps they move; they stay valid memory after close(). The GIL is "
      "released while the apps work.")
      .def(py::init<const std::string&, const std::string&, int, int, int, int, const std::string&,
                    const std::string&, double, const std::vector<int>&>(),
           py::kw_only(), py::arg("game"), py::arg("options") = "{}", py::arg("apps"),
           py::arg("threads") = 1, py::arg("width") = 120, py::arg("height") = 80,
           py::arg("renderer") = "automatic", py::arg("log_dir") = "",
           py::arg("fixed_delta_time_s") = TimeSettings{}.fixed_delta_time_s,
           py::arg("vision_channels") = std::vector<int>{},
           "options: JSON object. log_dir: app 7 logs to user007 below it; '' for no logs. "
           "vision_channels: what `vision` holds, 0 red, 1 green, 2 blue, 3 depth.")
      .def("reset", &PyAppBatch::reset, py::arg("indices"), py::arg("seeds"), py::arg("options"),
           py::arg("head"), py::arg("left_controller") = py::none(),
           py::arg("right_controller") = py::none(), py::arg("time_ns") = 0,
           "Starts rounds at time_ns: indices (M,), seeds (M,), poses (M, 7). Errors name the "
           "first app that "
           "refused; the others have started.")
      .def("step", &PyAppBatch::step, py::arg("indices"), py::arg("times_ns"), py::arg("head"),
           py::arg("left_controller") = py::none(), py::arg("right_controller") = py::none(),
           "One user step of K frames: indices (M,), times_ns (M, K), poses (M, K, 7). Errors as "
           "in reset.")
      .def_property_readonly("images", &PyAppBatch::images, "(N, height, width, 4) uint8 RGBA.")
      .def_property_readonly("vision", &PyAppBatch::vision,
                             "(N, channels, height, width) uint8: the vision_channels of images.")
      .def_property_readonly("rewards", &PyAppBatch::rewards, "(N,) float32 of the last step.")
      .def_property_readonly("finished", &PyAppBatch::finished, "(N,) uint8.")
      .def_property_readonly("time_features", &PyAppBatch::timeFeatures, "(N,) float32.")
      .def_property_readonly("log_names", &PyAppBatch::logNames,
                             "Names of the log's columns; empty before the first reset.")
      .def_property_readonly("logs", &PyAppBatch::logs, "(N, len(log_names)) float64.")
      .def_property_readonly("privileged_names", &PyAppBatch::privilegedNames,
                             "Names of the privileged numbers' columns; none for a game without.")
      .def_property_readonly("privileged", &PyAppBatch::privileged,
                             "(N, len(privileged_names)) float32 after the last frame.")
      .def("render_view", &PyAppBatch::renderView, py::arg("app"), py::arg("view"),
           py::arg("width"), py::arg("height"), "As App.render_view, of one app.")
      .def("save", &PyAppBatch::save, py::arg("app"), "As App.save, of one app.")
      .def("load", &PyAppBatch::load, py::arg("app"), py::arg("state"),
           "As App.load, of one app; its rows of images, vision, privileged and logs are its own "
           "again.")
      .def("state_hash", &PyAppBatch::stateHash, py::arg("app"), "As App.state_hash, of one app.")
      .def_property_readonly("capabilities", &PyAppBatch::capabilities,
                             "Names of what the apps can do.")
      .def_property_readonly("renderer_description", &PyAppBatch::rendererDescription)
      .def_property_readonly("threads", &PyAppBatch::threads, "Threads in use.")
      .def("close", &PyAppBatch::close, "Frees the apps; later calls raise StateError.");
}

}  // namespace sim2vr::bindings

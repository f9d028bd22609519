// SPDX-License-Identifier: Apache-2.0
// The extension module: the one place where C++ errors become Python's.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <array>
#include <exception>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "sim2vr/core/clock.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/core/text.hpp"
#include "sim2vr/core/version.hpp"
#include "sim2vr/games/registry.hpp"
#include "sim2vr/render/renderer.hpp"
#include "sim2vr/render/shown.hpp"
#include "sim2vr/runtime/app_batch.hpp"
#include "sim2vr/runtime/lockstep_app.hpp"
#include "sim2vr/xr/pose_row.hpp"

namespace py = pybind11;

namespace sim2vr::bindings {
namespace {

/// Paths, objects, layers, meshes, poses, scales, colours, unlit; a row of each per render::Shown.
using ShownColumns =
    std::tuple<std::vector<std::string>, pybind11::array_t<std::uint64_t>, pybind11::array_t<int>,
               pybind11::array_t<int>, pybind11::array_t<double>, pybind11::array_t<double>,
               pybind11::array_t<float>, pybind11::array_t<bool>>;

/// Name, vertices, triangles.
using MeshArrays =
    std::tuple<std::string, pybind11::array_t<float>, pybind11::array_t<std::uint32_t>>;

ShownColumns shownColumns(const std::vector<render::Shown>& all) {
  const auto count = static_cast<py::ssize_t>(all.size());
  py::array_t<std::uint64_t> objects(count);
  py::array_t<int> layers(count);
  py::array_t<int> meshes(count);
  py::array_t<double> poses({count, py::ssize_t{7}});
  py::array_t<double> scales({count, py::ssize_t{3}});
  py::array_t<float> colors({count, py::ssize_t{4}});
  py::array_t<bool> unlit(count);
  std::vector<std::string> paths;
  for (py::ssize_t i = 0; i < count; ++i) {
    const render::Shown& each = all[static_cast<std::size_t>(i)];
    paths.push_back(each.path);
    objects.mutable_at(i) = each.object;
    layers.mutable_at(i) = each.layer;
    meshes.mutable_at(i) = each.mesh;
    unlit.mutable_at(i) = each.unlit;
    for (int axis = 0; axis < 3; ++axis) {
      poses.mutable_at(i, axis) = each.pose.position[axis];
      scales.mutable_at(i, axis) = each.scale[axis];
    }
    const std::array<float, 4> rgba{each.color.r, each.color.g, each.color.b, each.color.a};
    for (int k = 0; k < 4; ++k) {
      poses.mutable_at(i, 3 + k) = each.pose.rotation.coeffs()[k];
      colors.mutable_at(i, k) = rgba.at(static_cast<std::size_t>(k));
    }
  }
  return {paths, objects, layers, meshes, poses, scales, colors, unlit};
}

MeshArrays meshArrays(const render::Mesh& mesh) {
  const auto corners = static_cast<py::ssize_t>(mesh.vertices.size());
  py::array_t<float> vertices({corners, py::ssize_t{3}});
  for (py::ssize_t i = 0; i < corners; ++i) {
    const Eigen::Vector3f& at = mesh.vertices[static_cast<std::size_t>(i)].position;
    for (int axis = 0; axis < 3; ++axis) vertices.mutable_at(i, axis) = at[axis];
  }
  const py::array_t<std::uint32_t> triangles(
      {static_cast<py::ssize_t>(mesh.triangleCount()), py::ssize_t{3}}, mesh.indices.data());
  return {mesh.name, vertices, triangles};
}

template <class T>
using Array = pybind11::array_t<T, pybind11::array::c_style | pybind11::array::forcecast>;
using Rows = Array<double>;
using OptionalRows = std::optional<Rows>;
using Shape = std::vector<pybind11::ssize_t>;

template <class T>
void checkShape(const char* name, const Array<T>& array, const Shape& shape) {
  const Shape got(array.shape(), array.shape() + array.ndim());
  if (got == shape) return;
  throw InvalidArgument(name, fmt::format("shape ({})", fmt::join(got, ", ")),
                        fmt::format("shape ({})", fmt::join(shape, ", ")));
}

/// Arrays of one shape with a row's numbers behind it; a device that is not tracked and inputs at
/// rest are missing. They must outlive this object.
class DeviceRows {
 public:
  struct Arrays {
    const Rows& head;
    const OptionalRows& left;
    const OptionalRows& right;
    const OptionalRows& left_inputs;
    const OptionalRows& right_inputs;
  };

  DeviceRows(const Arrays& arrays, const Shape& shape)
      : head_(checked("head", arrays.head, shape, xr::kPoseRowNumbers)),
        left_(checked("left_controller", arrays.left, shape, xr::kPoseRowNumbers)),
        right_(checked("right_controller", arrays.right, shape, xr::kPoseRowNumbers)),
        left_inputs_(checked("left_inputs", arrays.left_inputs, shape, xr::kInputRowNumbers)),
        right_inputs_(checked("right_inputs", arrays.right_inputs, shape, xr::kInputRowNumbers)) {}

  /// Row i, whatever the shape in front. Throws as xr::inputsFromRow.
  xr::DeviceState operator[](pybind11::ssize_t i) const {
    const auto row = [i](const double* rows, int numbers) {
      return rows == nullptr ? nullptr : rows + i * numbers;
    };
    std::array<xr::ControllerState, 2> inputs;
    if (left_ != nullptr) {
      inputs[0] = xr::inputsFromRow(xr::Hand::left, row(left_inputs_, xr::kInputRowNumbers));
    }
    if (right_ != nullptr) {
      inputs[1] = xr::inputsFromRow(xr::Hand::right, row(right_inputs_, xr::kInputRowNumbers));
    }
    return xr::devicesFromRows(row(head_, xr::kPoseRowNumbers), row(left_, xr::kPoseRowNumbers),
                               row(right_, xr::kPoseRowNumbers), inputs);
  }

 private:
  static const double* checked(const char* name, const Rows& rows, Shape shape, int numbers) {
    shape.push_back(numbers);
    checkShape(name, rows, shape);
    return rows.data();
  }
  static const double* checked(const char* name, const OptionalRows& rows, const Shape& shape,
                               int numbers) {
    return rows ? checked(name, *rows, shape, numbers) : nullptr;
  }

  const double* head_;
  const double* left_;
  const double* right_;
  const double* left_inputs_;
  const double* right_inputs_;
};

/// Hand, amplitude, frequency in Hz, duration in ns.
using Pulse = std::tuple<std::string, float, float, std::int64_t>;
/// Name, position in m, gain.
using Sound = std::tuple<std::string, std::array<double, 3>, float>;

/// One renderer of each kind serves every app that shares: contexts are costly, and drawing with
/// one takes turns.
std::shared_ptr<render::Renderer> sharedRenderer(render::RendererKind kind) {
  static std::mutex mutex;
  static std::map<render::RendererKind, std::weak_ptr<render::Renderer>> renderers;
  const std::lock_guard<std::mutex> lock(mutex);
  std::shared_ptr<render::Renderer> renderer = renderers[kind].lock();
  if (renderer == nullptr) {
    renderer = render::Renderer::create(kind);
    renderers[kind] = renderer;
  }
  return renderer;
}

/// The Python face of runtime::AppBatch. Its arrays are views that keep the batch alive.
class PyAppBatch {
 public:
  PyAppBatch(const std::string& game, const std::string& options, int apps, int threads, int width,
             int height, int eyes, float ipd_m, const std::string& renderer, bool share_renderer,
             const std::vector<std::string>& log_dirs, double fixed_delta_time_s,
             double maximum_delta_time_s, double fixed_step_tolerance_s,
             const std::vector<int>& vision_channels, int fovea_width, int fovea_height,
             float fovea_pixel_m) {
    runtime::BatchSettings settings;
    settings.app.game = game;
    settings.app.options_json = options;
    settings.app.headset_size = {width, height};
    settings.app.eyes = eyes;
    settings.app.ipd_m = ipd_m;
    settings.app.time.fixed_delta_time_s = fixed_delta_time_s;
    settings.app.time.maximum_delta_time_s = maximum_delta_time_s;
    settings.app.time.fixed_step_tolerance_s = fixed_step_tolerance_s;
    settings.log_dirs.assign(log_dirs.begin(), log_dirs.end());
    settings.apps = apps;
    settings.threads = threads;
    settings.renderer = render::rendererKindFromName(renderer);
    settings.vision_channels = vision_channels;
    settings.fovea_size = {fovea_width, fovea_height};
    settings.fovea_pixel_m = fovea_pixel_m;
    const py::gil_scoped_release release;
    if (share_renderer) settings.renderers.push_back(sharedRenderer(settings.renderer));
    batch_ = std::make_shared<runtime::AppBatch>(settings);
  }

  runtime::AppBatch& batch() const {
    if (batch_ == nullptr) throw StateError("the app is closed; make a new one");
    return *batch_;
  }

  void reset(const Array<int>& indices, const Array<std::uint32_t>& seeds,
             const std::string& options, const Rows& head, const OptionalRows& left,
             const OptionalRows& right, const OptionalRows& left_inputs,
             const OptionalRows& right_inputs, std::int64_t time_ns) {
    const py::ssize_t count = indices.size();
    checkShape("seeds", seeds, {count});
    const DeviceRows rows({head, left, right, left_inputs, right_inputs}, {count});
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

  void step(const Array<int>& indices, const Array<std::int64_t>& times_ns, const Rows& head,
            const OptionalRows& left, const OptionalRows& right, const OptionalRows& left_inputs,
            const OptionalRows& right_inputs, int drawn) {
    const py::ssize_t count = indices.size();
    if (times_ns.ndim() != 2) {
      throw InvalidArgument("times_ns", std::to_string(times_ns.ndim()) + " dimensions",
                            "2: apps and frames");
    }
    checkShape("times_ns", times_ns, {count, times_ns.shape(1)});
    const DeviceRows rows({head, left, right, left_inputs, right_inputs},
                          {count, times_ns.shape(1)});
    frames_.clear();
    for (py::ssize_t i = 0; i < times_ns.size(); ++i) {
      frames_.push_back({times_ns.data()[i], rows[i]});
    }
    const std::span<const int> apps(indices.data(), static_cast<std::size_t>(count));
    const py::gil_scoped_release release;
    batch().step(apps, frames_, drawn);
  }

  py::array_t<double> headRequests(const Array<int>& indices, const Array<std::uint32_t>& seeds,
                                   const std::string& options) const {
    checkShape("seeds", seeds, {indices.size()});
    py::array_t<double> pitches(indices.size());
    for (py::ssize_t i = 0; i < indices.size(); ++i) {
      const auto pitch = batch().app(indices.at(i)).headRequest({seeds.at(i), options});
      pitches.mutable_at(i) = pitch.value_or(std::numeric_limits<double>::quiet_NaN());
    }
    return pitches;
  }

  std::vector<Pulse> haptics(int app) const {
    std::vector<Pulse> pulses;
    for (const xr::HapticPulse& pulse : batch().app(app).events().haptics) {
      pulses.emplace_back(pulse.hand == xr::Hand::left ? "left" : "right", pulse.amplitude,
                          pulse.frequency_hz, pulse.duration_ns);
    }
    return pulses;
  }

  std::vector<Sound> sounds(int app) const {
    std::vector<Sound> events;
    for (const rl::SoundEvent& sound : batch().app(app).events().sounds) {
      const Vec3& at = sound.position_m;
      events.emplace_back(sound.name, std::array{at.x(), at.y(), at.z()}, sound.gain);
    }
    return events;
  }

  template <class T>
  py::array_t<T> view(std::span<const T> values, std::vector<py::ssize_t> shape,
                      bool writeable = false) const {
    auto* owner = new std::shared_ptr<runtime::AppBatch>(batch_);
    const py::capsule base(
        owner, [](void* kept) { delete static_cast<std::shared_ptr<runtime::AppBatch>*>(kept); });
    py::array_t<T> array(std::move(shape), values.data(), base);
    if (!writeable) array.attr("flags").attr("writeable") = false;
    return array;
  }

  py::array_t<float> privilegedRows(std::span<const float> rows) const {
    return view(rows, {batch().size(), static_cast<py::ssize_t>(batch().privilegedNames().size())});
  }

  py::array_t<std::uint8_t> images() const {
    const runtime::AppSettings& app = batch().settings().app;
    const auto [width, height] = app.headset_size;
    std::vector<py::ssize_t> shape{batch().size(), height, width, 4};
    if (app.eyes > 1) shape.insert(shape.begin() + 1, app.eyes);
    return view(batch().images(), shape);
  }
  py::array_t<std::uint8_t> vision() const {
    const runtime::AppSettings& app = batch().settings().app;
    const auto [width, height] = app.headset_size;
    const auto channels = static_cast<py::ssize_t>(batch().settings().vision_channels.size());
    return view(batch().vision(), {batch().size(), app.eyes * channels, height, width});
  }
  py::array_t<std::uint8_t> fovea() const {
    const auto [width, height] = batch().settings().fovea_size;
    return view(batch().fovea(), {batch().size(), height, width, 4});
  }
  py::array_t<float> foveaDepth() const {
    const auto [width, height] = batch().settings().fovea_size;
    return view(batch().foveaDepth(), {batch().size(), height, width});
  }
  py::array_t<float> gaze() const { return view<float>(batch().gaze(), {batch().size(), 2}, true); }
  py::array_t<float> rewards() const { return view(batch().rewards(), {batch().size()}); }
  py::array_t<std::uint8_t> finished() const { return view(batch().finished(), {batch().size()}); }
  py::array_t<float> timeFeatures() const { return view(batch().timeFeatures(), {batch().size()}); }
  py::array_t<std::int32_t> hapticCounts() const {
    return view(batch().hapticCounts(), {batch().size()});
  }
  py::array_t<std::int32_t> soundCounts() const {
    return view(batch().soundCounts(), {batch().size()});
  }
  std::vector<std::string> logNames() const { return batch().logNames(); }
  std::vector<std::string> privilegedNames() const { return batch().privilegedNames(); }
  py::array_t<float> privileged() const { return privilegedRows(batch().privileged()); }
  py::array_t<float> privilegedDrawn() const { return privilegedRows(batch().privilegedDrawn()); }
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

  py::tuple renderFrom(int app, const std::array<double, xr::kPoseRowNumbers>& pose,
                       double vertical_fov_deg, int width, int height) {
    const render::ImageSize size{width, height};
    render::checkImageSize(size);
    py::array_t<std::uint8_t> image({height, width, 4});
    py::array_t<float> depth_m({height, width});
    {
      const std::span<std::uint8_t> rgba(image.mutable_data(), size.pixels() * 4);
      const std::span<float> depth(depth_m.mutable_data(), size.pixels());
      const py::gil_scoped_release release;
      batch().app(app).renderFrom(xr::poseFromRow(pose.data()), vertical_fov_deg, size, rgba,
                                  depth);
    }
    return py::make_tuple(image, depth_m);
  }

  ShownColumns shown(int app) const { return shownColumns(batch().app(app).shown()); }
  MeshArrays shownMesh(int app, int number) const {
    return meshArrays(batch().app(app).shownMesh(number));
  }

  py::bytes save(int app) const {
    std::string state;
    {
      const py::gil_scoped_release release;
      state = batch().app(app).save();
    }
    return py::bytes(state);
  }
  void load(int app, const py::bytes& state) {
    const std::string saved = state;
    const py::gil_scoped_release release;
    batch().load(app, saved);
  }
  std::uint64_t stateHash(int app) const {
    const py::gil_scoped_release release;
    return batch().app(app).stateHash();
  }
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
      "N apps of one game, stepped together on threads; one app is a batch of one. Poses are "
      "float64 rows of 7: position x y z (m), rotation x y z w, app frame (left-handed, y up, z "
      "forward); inputs of a controller are rows of 13 (client/devices.py). M apps are chosen by "
      "their indices. Arrays of results are read-only views without copies: calls overwrite the "
      "rows of the apps they move; they stay valid memory after close(). The GIL is released while "
      "the apps work; one AppBatch must not be used from two threads at once, different ones may.")
      .def(py::init<const std::string&, const std::string&, int, int, int, int, int, float,
                    const std::string&, bool, const std::vector<std::string>&, double, double,
                    double, const std::vector<int>&, int, int, float>(),
           py::kw_only(), py::arg("game"), py::arg("options") = "{}", py::arg("apps") = 1,
           py::arg("threads") = 1, py::arg("width") = 120, py::arg("height") = 80,
           py::arg("eyes") = 1, py::arg("ipd_m") = runtime::AppSettings{}.ipd_m,
           py::arg("renderer") = "automatic", py::arg("share_renderer") = false,
           py::arg("log_dirs") = std::vector<std::string>{},
           py::arg("fixed_delta_time_s") = TimeSettings{}.fixed_delta_time_s,
           py::arg("maximum_delta_time_s") = TimeSettings{}.maximum_delta_time_s,
           py::arg("fixed_step_tolerance_s") = TimeSettings{}.fixed_step_tolerance_s,
           py::arg("vision_channels") = std::vector<int>{}, py::arg("fovea_width") = 0,
           py::arg("fovea_height") = 0, py::arg("fovea_pixel_m") = 0.0F,
           "options: JSON object. share_renderer: the first thread draws with the renderer that "
           "the process shares. log_dirs: root of each app's episode logs; [] for no logs. The "
           "times are those of TimeSettings in core/clock.hpp. vision_channels: what `vision` "
           "holds, 0 red, 1 green, 2 blue, 3 depth. fovea_*: size in pixels of `fovea`, 0: none, "
           "and "
           "width of a pixel at a depth of 1 m.")
      .def("reset", &PyAppBatch::reset, py::arg("indices"), py::arg("seeds"), py::arg("options"),
           py::arg("head"), py::arg("left_controller") = py::none(),
           py::arg("right_controller") = py::none(), py::arg("left_inputs") = py::none(),
           py::arg("right_inputs") = py::none(), py::arg("time_ns") = 0,
           "Starts rounds at time_ns: indices (M,), seeds (M,), poses (M, 7), inputs (M, 13). "
           "Errors "
           "name the first app that refused; the others have started.")
      .def("step", &PyAppBatch::step, py::arg("indices"), py::arg("times_ns"), py::arg("head"),
           py::arg("left_controller") = py::none(), py::arg("right_controller") = py::none(),
           py::arg("left_inputs") = py::none(), py::arg("right_inputs") = py::none(),
           py::arg("drawn") = runtime::kLastFrame,
           "One user step of K frames, of which `drawn` (-1: the last) is drawn: indices (M,), "
           "times_ns (M, K), poses (M, K, 7), inputs (M, K, 13). Errors as in reset.")
      .def_property_readonly("images", &PyAppBatch::images,
                             "(N, height, width, 4) uint8 RGBA headset images, row 0 = top, alpha "
                             "= linear depth / far plane; with two eyes (N, 2, height, width, 4).")
      .def_property_readonly(
          "vision", &PyAppBatch::vision,
          "(N, eyes * channels, height, width) uint8: the vision_channels of images.")
      .def_property_readonly("fovea", &PyAppBatch::fovea,
                             "(N, height, width, 4) uint8 like images: windows around the gaze.")
      .def_property_readonly("fovea_depth", &PyAppBatch::foveaDepth,
                             "(N, height, width) float32: depths of fovea, m.")
      .def_property_readonly("gaze", &PyAppBatch::gaze,
                             "(N, 2) float32, writable: middles of the next windows, right and up, "
                             "m at a depth of 1 m.")
      .def_property_readonly("rewards", &PyAppBatch::rewards, "(N,) float32 of the last step.")
      .def_property_readonly("finished", &PyAppBatch::finished, "(N,) uint8.")
      .def_property_readonly("time_features", &PyAppBatch::timeFeatures, "(N,) float32.")
      .def_property_readonly("haptic_counts", &PyAppBatch::hapticCounts,
                             "(N,) int32: haptic pulses of the last step or reset.")
      .def_property_readonly("sound_counts", &PyAppBatch::soundCounts,
                             "(N,) int32: sounds of the last step or reset.")
      .def("haptics", &PyAppBatch::haptics, py::arg("app"),
           "The pulses of one app: (hand, amplitude, frequency in Hz, duration in ns).")
      .def("sounds", &PyAppBatch::sounds, py::arg("app"),
           "The sounds of one app: (name, position in m, gain).")
      .def_property_readonly("log_names", &PyAppBatch::logNames,
                             "Names of the log's columns; empty before the first reset.")
      .def_property_readonly("logs", &PyAppBatch::logs, "(N, len(log_names)) float64.")
      .def_property_readonly("privileged_names", &PyAppBatch::privilegedNames,
                             "Names of the privileged numbers' columns; none for a game without.")
      .def_property_readonly("privileged", &PyAppBatch::privileged,
                             "(N, len(privileged_names)) float32 after the last frame.")
      .def_property_readonly("privileged_drawn", &PyAppBatch::privilegedDrawn,
                             "(N, len(privileged_names)) float32 after the frame that is drawn.")
      .def("head_requests", &PyAppBatch::headRequests, py::arg("indices"), py::arg("seeds"),
           py::arg("options"),
           "(M,) float64 pitch of the head, degrees up, that the rounds of these seeds wish for; "
           "NaN: no wish.")
      .def("render_view", &PyAppBatch::renderView, py::arg("app"), py::arg("view"),
           py::arg("width"), py::arg("height"),
           "An app's last frame from 'headset', 'recorder' or 'spectator', (height, width, 4) "
           "uint8.")
      .def("render_from", &PyAppBatch::renderFrom, py::arg("app"), py::arg("pose"),
           py::arg("vertical_fov_deg"), py::arg("width"), py::arg("height"),
           "An app's last frame from a pose x y z, x y z w of its frame, without what stands for "
           "the player: (height, width, 4) uint8, and (height, width) float32 depth in m.")
      .def("shown", &PyAppBatch::shown, py::arg("app"),
           "What an app's last frame holds and shows, K rows: paths, objects (K,), layers (K,), "
           "meshes (K,) with -1 for none, poses (K, 7), scales (K, 3), colours (K, 4) sRGB and "
           "alpha, unlit (K,).")
      .def("shown_mesh", &PyAppBatch::shownMesh, py::arg("app"), py::arg("mesh"),
           "A mesh that `shown` numbered: name, vertices (V, 3), triangles (T, 3), whose fronts "
           "are clockwise in the app's left-handed frame.")
      .def("save", &PyAppBatch::save, py::arg("app"),
           "The whole state of one app as bytes, mid-round included.")
      .def("load", &PyAppBatch::load, py::arg("app"), py::arg("state"),
           "Goes on from saved bytes; EngineError for damaged or foreign ones. The app's rows of "
           "images, vision, privileged and logs are its own again.")
      .def("state_hash", &PyAppBatch::stateHash, py::arg("app"),
           "64-bit hash of what save() would return.")
      .def_property_readonly("capabilities", &PyAppBatch::capabilities,
                             "Names of what the apps can do.")
      .def_property_readonly("renderer_description", &PyAppBatch::rendererDescription)
      .def_property_readonly("threads", &PyAppBatch::threads, "Threads in use.")
      .def("close", &PyAppBatch::close, "Frees the apps; later calls raise StateError.");
}

}  // namespace sim2vr::bindings

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

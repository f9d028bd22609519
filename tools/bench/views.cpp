// Developers' tool: the CPU time of small pictures of a round that is being played. JSON rows.
//
// Every view has an app of its own; between the pictures the apps move on, unmeasured. CPU time
// instead of wall time, so that other programs on the machine hardly count; the median over
// batches.
#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "frame.hpp"
#include "mesh_cache.hpp"
#include "sim2vr/core/clock.hpp"
#include "sim2vr/render/image_io.hpp"
#include "sim2vr/runtime/app.hpp"
#include "sim2vr/runtime/thread_pool.hpp"
#include "sim2vr/xr/pose_row.hpp"

namespace {

using namespace sim2vr;

constexpr const char* kUsage = R"(usage: bench_views [--name value]...
  --views 32             pictures per batch
  --threads 1            threads, each with a share of the views and a renderer
  --share 0              1: one renderer for all threads
  --single 0             1: render() for each view instead of renderBatch()
  --batches 200          measured batches
  --width 120 --height 80
  --condition medium     of the game whacamole
  --renderer automatic   or egl, osmesa
  --variants ''         settings of the environment, e.g. "A=1,A=2": renderers made under each
                         take turns over the same pictures, and each gets a row
  --png FOLDER           also writes the last batch's pictures
  --table 0              1: triangles per mesh instead of the row
)";

struct Settings {
  int views = 32;
  int threads = 1;
  bool share = false;
  bool single = false;
  int batches = 200;
  render::ImageSize size{120, 80};
  std::string condition = "medium";
  std::string renderer = "automatic";
  std::string variants;
  std::string png;
  bool table = false;
};

Settings settingsFrom(int argc, char** argv) {
  std::map<std::string, std::string> given;
  for (int i = 1; i + 1 < argc; i += 2) given[argv[i]] = argv[i + 1];
  Settings settings;
  const auto text = [&](const char* name, std::string& value) {
    if (const auto found = given.extract(name)) value = found.mapped();
  };
  const auto number = [&](const char* name, auto& value) {
    if (const auto found = given.extract(name)) {
      value = static_cast<std::remove_reference_t<decltype(value)>>(std::stoi(found.mapped()));
    }
  };
  number("--views", settings.views);
  number("--threads", settings.threads);
  number("--share", settings.share);
  number("--single", settings.single);
  number("--batches", settings.batches);
  number("--width", settings.size.width);
  number("--height", settings.size.height);
  text("--condition", settings.condition);
  text("--renderer", settings.renderer);
  text("--variants", settings.variants);
  text("--png", settings.png);
  number("--table", settings.table);
  if (argc % 2 == 0 || !given.empty()) throw std::invalid_argument(kUsage);
  return settings;
}

/// A hammer that swings at the area, differently for every player; it hits now and then.
xr::DeviceState player(int index, int frame) {
  const double t = 0.05 * frame + 0.7 * index;
  const double head[7] = {0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0};
  const double right[7] = {0.15 + 0.12 * std::sin(1.3 * t),
                           1.03 + 0.12 * std::cos(0.9 * t),
                           0.24 + 0.14 * std::sin(9.0 * t),
                           0.0,
                           0.0,
                           0.0,
                           1.0};
  return xr::devicesFromRows(head, nullptr, right);
}

double processCpu_us() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return 1e6 * static_cast<double>(now.tv_sec) + 1e-3 * static_cast<double>(now.tv_nsec);
}

class Bench {
 public:
  explicit Bench(const Settings& settings) : settings_(settings), pool_(settings.threads) {
    const auto nothing = render::Renderer::create(render::RendererKind::null);
    runtime::AppSettings app;
    app.options_json = nlohmann::json{{"condition", settings.condition}}.dump();
    app.headset_size = settings.size;
    for (int i = 0; i < settings.views; ++i) {
      apps_.push_back(std::make_unique<runtime::App>(app, nothing));
      apps_.back()->begin({.seed = static_cast<std::uint32_t>(i)}, player(i, 0));
    }
    std::istringstream names(settings.variants);
    std::string name;
    while (std::getline(names, name, ',')) addVariant(name);
    if (variants_.empty()) addVariant("");
    for (int i = 0; i < kWarmUp; ++i) play();
  }

  void run() {
    double triangles = 0.0;
    // The driver compiles its code, and the sky is kept from the second picture on.
    for (int i = 0; i < 2; ++i) {
      for (Variant& variant : variants_) draw(variant);
    }
    for (int batch = 0; batch < settings_.batches; ++batch) {
      play();
      for (Variant& variant : variants_) measure(variant);
      triangles += countTriangles();
    }
    for (Variant& variant : variants_) {
      std::printf("%s\n", row(variant, triangles / settings_.batches).dump().c_str());
    }
    if (!settings_.png.empty()) writePictures();
  }

  /// Mean triangles per view by mesh, and draw calls.
  nlohmann::json table() {
    std::map<std::string, double> sums;
    for (int batch = 0; batch < settings_.batches; ++batch) {
      play();
      countTriangles(&sums);
    }
    for (auto& [name, sum] : sums) sum /= settings_.batches * settings_.views;
    return sums;
  }

 private:
  struct Variant {
    std::string setting;
    std::vector<std::shared_ptr<render::Renderer>> renderers;
    std::vector<double> times_us;
    std::uint64_t hash = 14695981039346656037U;  // FNV-1a
  };

  static constexpr int kWarmUp = 40;
  static constexpr int kRate_hz = 20;

  void play() {
    ++frame_;
    for (int i = 0; i < settings_.views; ++i) {
      const runtime::FrameInput input{lockstepFrameTimeNs(frame_, kRate_hz), player(i, frame_)};
      runtime::App& app = *apps_[static_cast<std::size_t>(i)];
      app.startStep(std::span(&input, 1));
      if (app.finishStep().finished) {
        throw std::runtime_error("the round is over: fewer batches");
      }
    }
  }

  void addVariant(const std::string& setting) {
    const std::size_t equals = setting.find('=');
    const std::string name = setting.substr(0, equals);
    if (equals != std::string::npos) setenv(name.c_str(), setting.c_str() + equals + 1, 1);
    Variant& variant = variants_.emplace_back();
    variant.setting = setting;
    for (int i = 0; i < (settings_.share ? 1 : settings_.threads); ++i) {
      variant.renderers.push_back(
          render::Renderer::create(render::rendererKindFromName(settings_.renderer)));
    }
    if (equals != std::string::npos) unsetenv(name.c_str());
  }

  void measure(Variant& variant) {
    const double start = processCpu_us();
    draw(variant);
    variant.times_us.push_back((processCpu_us() - start) / settings_.views);
    for (const auto& app : apps_) {
      for (const std::uint8_t byte : app->image()) {
        variant.hash = (variant.hash ^ byte) * 1099511628211U;
      }
    }
  }

  nlohmann::json row(Variant& variant, double triangles) const {
    std::vector<double>& times_us = variant.times_us;
    std::sort(times_us.begin(), times_us.end());
    const char* lp_threads = std::getenv("LP_NUM_THREADS");
    return {{"variant", variant.setting},
            {"us_per_view", times_us[times_us.size() / 2]},
            {"us_per_view_quarter", times_us[times_us.size() / 4]},
            {"us_per_view_fastest", times_us.front()},
            {"triangles_per_view", triangles},
            {"images_hash", fmt::format("{:016x}", variant.hash)},
            {"views", settings_.views},
            {"threads", settings_.threads},
            {"one_renderer", settings_.share},
            {"single", settings_.single},
            {"size", {settings_.size.width, settings_.size.height}},
            {"condition", settings_.condition},
            {"batches", settings_.batches},
            {"renderer", variant.renderers.front()->description()},
            {"LP_NUM_THREADS", lp_threads == nullptr ? "" : lp_threads}};
  }

  void draw(Variant& variant) {
    pool_.run([&](int worker) {
      const int count = settings_.views / settings_.threads;
      const int first = worker * count;
      std::vector<render::ViewRequest> requests;
      for (int i = first; i < first + count; ++i) requests.push_back(request(i));
      render::Renderer& renderer =
          *variant.renderers[settings_.share ? 0 : static_cast<std::size_t>(worker)];
      if (!settings_.single) return renderer.renderBatch(requests);
      for (const auto& each : requests) {
        renderer.render(each.scene, each.camera, each.size, each.rgba);
      }
    });
  }

  render::ViewRequest request(int index) {
    std::vector<render::ViewRequest> views;
    apps_[static_cast<std::size_t>(index)]->addViews(views);
    return views.front();
  }

  double countTriangles(std::map<std::string, double>* by_mesh = nullptr) {
    std::size_t indices = 0;
    for (int i = 0; i < settings_.views; ++i) {
      const render::ViewRequest view = request(i);
      collector_.collect(view.scene, view.camera, view.size, frame_found_);
      for (const auto* items : {&frame_found_.opaque, &frame_found_.alpha}) {
        for (const render::DrawItem& item : *items) {
          indices += item.mesh->index_count;
          if (by_mesh == nullptr) continue;
          const auto mesh = item.mesh->mesh.lock();
          (*by_mesh)[mesh->name + (items == &frame_found_.opaque ? "" : " (alpha)")] +=
              item.mesh->index_count / 3.0;
          (*by_mesh)["items"] += 1.0;
        }
      }
    }
    return static_cast<double>(indices) / 3.0 / settings_.views;
  }

  void writePictures() const {
    for (std::size_t i = 0; i < apps_.size(); ++i) {
      const std::span<const std::uint8_t> rgba = apps_[i]->image();
      std::vector<std::uint8_t> rgb;
      for (std::size_t p = 0; p < rgba.size(); p += 4) {
        rgb.insert(rgb.end(), {rgba[p], rgba[p + 1], rgba[p + 2]});
      }
      render::writePng(fmt::format("{}/view{:03d}.png", settings_.png, i), settings_.size, rgb, 3);
    }
  }

  Settings settings_;
  runtime::ThreadPool pool_;
  std::vector<std::unique_ptr<runtime::App>> apps_;
  std::vector<Variant> variants_;
  render::MeshCache meshes_;
  render::FrameCollector collector_{meshes_};
  render::Frame frame_found_;
  int frame_ = 0;
};

}  // namespace

int main(int argc, char** argv) {
  try {
    const Settings settings = settingsFrom(argc, argv);
    Bench bench(settings);
    if (settings.table) {
      std::printf("%s\n", bench.table().dump().c_str());
    } else {
      bench.run();
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}

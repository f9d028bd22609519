// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/runtime/app.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/options.hpp"
#include "sim2vr/physics/world.hpp"
#include "sim2vr/rl/episode_logger.hpp"
#include "sim2vr/rl/room_looks.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/frames.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::runtime {
namespace {

constexpr std::string_view kStateFormat = "sim2vr app state 2";
constexpr double kUnitTolerance = 1e-3;
constexpr double kWidest_deg = 180.0;

xr::SessionSettings sessionSettings(const AppSettings& app) {
  const render::ImageSize size = app.headset_size;
  xr::SessionSettings settings;
  settings.ipd_m = app.ipd_m;
  settings.aspect = static_cast<float>(size.width) / static_cast<float>(size.height);
  return settings;
}

/// Of a view that was located in the head's own space.
render::EyeView eyeView(const XrView& view) {
  return {.camera_T_eye = xr::fromXr(view.pose),
          .left = std::tan(view.fov.angleLeft),
          .right = std::tan(view.fov.angleRight),
          .down = std::tan(view.fov.angleDown),
          .up = std::tan(view.fov.angleUp)};
}

Capabilities capabilitiesOf(const rl::Game& game) {
  Capabilities all{Capability::save,   Capability::views,           Capability::frames,
                   Capability::inputs, Capability::left_controller, Capability::haptics,
                   Capability::sounds, Capability::head_request,    Capability::two_eyes,
                   Capability::scene,  Capability::observers};
  if (!game.privilegedNames().empty()) all.insert(Capability::privileged);
  return all;
}

void configureGame(rl::Game& game, const std::string& options_json) {
  Options options = Options::fromJson(options_json);
  game.configure(options);
  options.expectAllRead();
}

}  // namespace

/// What lives as long as a round. Members are destroyed in reverse order: the scene's components
/// hold references to the world and the session.
struct App::Round {
  Round(const AppSettings& app, std::int64_t start_ns)
      : session(sessionSettings(app)), scene(app.time), physics(scene) {
    scene.clock().restart(start_ns);
  }

  xr::Session session;
  scene::Scene scene;
  physics::PhysicsWorld physics;
  rl::SoundLog sounds;
  rl::RLEnv* env = nullptr;
  /// Null for a game without one.
  const render::Camera* head_camera = nullptr;
};

AppFactory gameApps() { return gameApps(games::createGame); }

AppFactory gameApps(GameMaker make_game) {
  return [make_game](const AppSettings& settings, std::shared_ptr<render::Renderer> renderer,
                     std::span<std::uint8_t> image) {
    return std::make_unique<App>(settings, std::move(renderer), image, make_game);
  };
}

App::App(AppSettings settings, std::shared_ptr<render::Renderer> renderer,
         std::span<std::uint8_t> image, GameMaker make_game)
    : settings_(std::move(settings)),
      renderer_(std::move(renderer)),
      make_game_(std::move(make_game)),
      game_(make_game_(settings_.game)),
      capabilities_(capabilitiesOf(*game_)),
      image_(image) {
  settings_.validate();
  sessionSettings(settings_).validate();
  settings_.options_json = mergedOptions("{}", settings_.options_json);
  configureGame(*game_, settings_.options_json);
  if (!settings_.log_dir.empty()) {
    logger_ = std::make_unique<rl::EpisodeLogger>(settings_.log_dir);
  }
  const std::size_t bytes = settings_.imageBytes();
  if (image_.empty()) {
    own_image_.resize(bytes);
    image_ = own_image_;
  }
  if (image_.size() != bytes) {
    throw InvalidArgument("image", std::to_string(image_.size()) + " bytes",
                          std::to_string(bytes) + ", eyes x height x width x 4");
  }
}

App::~App() = default;

App::Round& App::round(std::string_view call) const {
  if (round_ == nullptr) {
    throw StateError(std::string(call) + ": no round was started; call reset first");
  }
  return *round_;
}

void App::buildRound(std::uint32_t seed, std::int64_t start_ns, rl::EpisodeLogger* logger) {
  seed_ = seed;
  round_.reset();
  auto fresh = std::make_unique<Round>(settings_, start_ns);
  rl::GameContext context{.scene = fresh->scene,
                          .xr = fresh->session,
                          .physics = fresh->physics,
                          .seed = seed,
                          .logger = logger,
                          .sounds = fresh->sounds};
  fresh->env = &game_->build(context);
  rl::addOutsideCameras(fresh->scene);
  const scene::GameObject* head = fresh->scene.find(rl::kHeadCameraPath);
  if (head != nullptr) fresh->head_camera = head->getComponent<render::Camera>();
  if (!fresh->session.attached()) fresh->session.attachActionSets();
  round_ = std::move(fresh);
}

Outcome App::doBegin(const RoundStart& start, const xr::DeviceState& devices) {
  if (start.time_ns < 0) {
    throw InvalidArgument("time_ns", std::to_string(start.time_ns), "0 or above");
  }
  const xr::DeviceState checked = xr::validated(devices);
  const std::string merged = mergedOptions(settings_.options_json, start.options_json);
  if (merged != settings_.options_json) {
    try {
      configureGame(*game_, merged);
    } catch (...) {
      configureGame(*game_, settings_.options_json);
      throw;
    }
    settings_.options_json = merged;
  }
  buildRound(start.seed, start.time_ns, logger_.get());
  step_.open = false;
  runFrame({start.time_ns, checked});
  return outcome(round_->env->reward());
}

void App::doStartStep(std::span<const FrameInput> frames, std::size_t drawn) {
  Round& current = round("step");
  if (step_.open) throw StateError("step: one was started already; finish it first");
  if (current.env->finished()) {
    throw StateError("step: the round is over; call reset to start the next one");
  }
  step_.frames.clear();
  std::int64_t previous_ns = current.session.frameTime();
  for (const FrameInput& frame : frames) {
    step_.frames.push_back({frame.time_ns, xr::validated(frame.devices)});
    if (frame.time_ns < previous_ns) {
      throw InvalidArgument("time_ns", std::to_string(frame.time_ns),
                            "a time not before the previous frame's " +
                                std::to_string(previous_ns) + " (clocks must not go backwards)");
    }
    previous_ns = frame.time_ns;
  }
  current.env->beginStep(static_cast<int>(frames.size()));
  step_.run = 0;
  step_.reward = 0.0F;
  step_.open = true;
  runFramesTo(drawn + 1);
}

Outcome App::finishStep() {
  round("finishStep");
  if (!step_.open) throw StateError("finishStep: no step was started; call startStep first");
  runFramesTo(step_.frames.size());
  step_.open = false;
  return outcome(step_.reward);
}

void App::runFramesTo(std::size_t end) {
  const rl::RLEnv& env = *round_->env;
  for (; step_.run < end && !env.finished(); ++step_.run) {
    throwIfStopped();
    runFrame(step_.frames[step_.run]);
    step_.reward += env.reward();
  }
}

void App::runFrame(const FrameInput& frame) {
  Round& current = *round_;
  current.session.nextFrame(frame.time_ns, frame.devices);
  current.scene.runFrame(frame.time_ns, [&current] { current.physics.step(); });
  if (logger_ != nullptr && current.env->finished()) logger_->endRound();
}

Outcome App::outcome(float reward) {
  events_ = {round_->session.takePulses(), round_->sounds.take()};
  const rl::RLEnv& env = *round_->env;
  return {reward, env.finished(), env.timeFeature()};
}

const std::map<std::string, double>& App::log() const {
  const rl::RLEnv& env = *round("log").env;
  return env.log();
}

std::optional<double> App::headRequest(const RoundStart& start) const {
  const std::string merged = mergedOptions(settings_.options_json, start.options_json);
  if (merged == settings_.options_json) return game_->headRequest(start.seed);
  const std::unique_ptr<rl::Game> game = make_game_(settings_.game);
  configureGame(*game, merged);
  return game->headRequest(start.seed);
}

void App::fillPrivileged(std::span<float> values) const {
  if (!can(Capability::privileged)) throw Unsupported(Capability::privileged);
  if (values.size() != privilegedNames().size()) {
    throw InvalidArgument("values", std::to_string(values.size()) + " numbers",
                          std::to_string(privilegedNames().size()));
  }
  round("fillPrivileged").env->fillPrivileged(values);
}

const render::Camera& App::camera(View view) const {
  static constexpr std::array<std::string_view, 3> kPaths{
      rl::kHeadCameraPath, rl::kThirdPersonCameraPath, rl::kSpectatorCameraPath};
  const Round& current = round("renderView");
  if (view == View::headset && current.head_camera != nullptr) return *current.head_camera;
  const std::string_view path = kPaths.at(static_cast<std::size_t>(view));
  const scene::GameObject* object = current.scene.find(path);
  const auto* found = object == nullptr ? nullptr : object->getComponent<render::Camera>();
  if (found == nullptr) {
    throw InvalidArgument("view", "one without a camera",
                          "a camera at '" + std::string(path) + "' in the game's scene");
  }
  return *found;
}

void App::renderView(View view, render::ImageSize size, std::span<std::uint8_t> rgba) {
  renderer_->render(round("renderView").scene, camera(view), size, rgba);
}

void App::renderFrom(const Pose& app_T_observer, double vertical_fov_deg, render::ImageSize size,
                     std::span<std::uint8_t> rgba, std::span<float> depth_m) {
  const render::Camera& head = camera(View::headset);
  const bool placed = app_T_observer.isFinite() &&
                      std::abs(app_T_observer.rotation.norm() - 1.0) < kUnitTolerance &&
                      vertical_fov_deg > 0.0 && vertical_fov_deg < kWidest_deg;
  if (!placed) {
    throw InvalidArgument("observer", "another pose or angle of view",
                          "a finite pose with a unit quaternion and an angle between 0 and 180");
  }
  const double up = std::tan(vertical_fov_deg * std::numbers::pi / 360.0);
  const double right = up * size.width / size.height;
  const render::EyeView eye{head.transform().pose().inverse() * app_T_observer, -right, right, -up,
                            up};
  const render::ViewRequest request{round("renderFrom").scene, head, size, rgba, eye, depth_m};
  renderer_->renderBatch(std::span(&request, 1));
}

std::vector<render::Shown> App::shown() { return render::shownBy(round("shown").scene, meshes_); }

void App::addViews(std::vector<render::ViewRequest>& views) {
  Round& current = round("draw");
  const render::Camera& head = camera(View::headset);
  if (settings_.eyes == 1) {
    views.push_back({current.scene, head, settings_.headset_size, image_});
    return;
  }
  int eye = 0;
  for (const XrView& view : current.session.locateViews()) {
    views.push_back({current.scene, head, settings_.headset_size, eyeImage(eye++), eyeView(view)});
  }
}

void App::addWindow(std::vector<render::ViewRequest>& views, const render::EyeView& eye,
                    render::ImageSize size, std::span<std::uint8_t> rgba,
                    std::span<float> depth_m) {
  views.push_back({round("draw").scene, camera(View::headset), size, rgba, eye, depth_m});
}

void App::draw() {
  std::vector<render::ViewRequest> views;
  addViews(views);
  renderer_->renderBatch(views);
}

std::span<std::uint8_t> App::eyeImage(int eye) const {
  const std::size_t bytes = settings_.headset_size.pixels() * 4;
  return image_.subspan(static_cast<std::size_t>(eye) * bytes, bytes);
}

void App::fields(Archive& archive) {
  std::string format(kStateFormat);
  std::string game = settings_.game;
  archive.field("format", format);
  archive.field("game", game);
  if (format != kStateFormat || game != settings_.game) {
    throw EngineError("saved state: it is of the game '" + game + "' (" + format +
                      "), this app plays '" + settings_.game + "' (" + std::string(kStateFormat) +
                      ")");
  }
  archive.field("options", settings_.options_json);
  archive.field("seed", seed_);
  if (archive.loading()) {
    configureGame(*game_, settings_.options_json);
    // A loaded round writes no log: its first part went to another app's files.
    buildRound(seed_, 0, nullptr);
  }
  archive.field("carried", *game_);
  archive.field("scene", round_->scene);
  archive.field("physics", round_->physics);
  archive.field("session", round_->session);
}

std::string App::save() {
  round("save");
  Archive archive = Archive::saver();
  archive.byteOrder();
  fields(archive);
  return archive.bytes();
}

void App::load(const std::string& state) {
  const std::string options = settings_.options_json;
  try {
    try {
      Archive archive = Archive::loader(state);
      archive.byteOrder();
      fields(archive);
      archive.expectEnd();
    } catch (const InvalidArgument& error) {
      throw EngineError(std::string("saved state: ") + error.what());
    }
  } catch (...) {
    round_.reset();
    settings_.options_json = options;
    configureGame(*game_, options);
    throw;
  }
  events_ = {};
  step_.open = false;
  draw();
}

std::uint64_t App::stateHash() {
  round("stateHash");
  Archive archive = Archive::saver();
  fields(archive);
  return archive.hash();
}

}  // namespace sim2vr::runtime

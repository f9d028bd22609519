#include "sim2vr/runtime/app.hpp"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <string>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/options.hpp"
#include "sim2vr/games/registry.hpp"
#include "sim2vr/physics/world.hpp"
#include "sim2vr/rl/episode_logger.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/session.hpp"
#include "sim2vr/xr/simulated_device.hpp"

namespace sim2vr::runtime {
namespace {

constexpr std::string_view kStateFormat = "sim2vr app state 1";
constexpr double kNsPerSecond = 1e9;

xr::SessionSettings sessionSettings(render::ImageSize size) {
  xr::SessionSettings settings;
  settings.aspect = static_cast<float>(size.width) / static_cast<float>(size.height);
  return settings;
}

std::string mergedOptions(const std::string& current, std::string_view changes) {
  nlohmann::json merged = nlohmann::json::parse(current);
  const nlohmann::json added = nlohmann::json::parse(changes, nullptr, false);
  if (!added.is_object()) {
    throw InvalidArgument("options", "'" + std::string(changes.substr(0, 80)) + "'",
                          "a JSON object");
  }
  merged.update(added);
  return merged.dump();
}

void configureGame(rl::Game& game, const std::string& options_json) {
  Options options = Options::fromJson(options_json);
  game.configure(options);
  options.expectAllRead();
}

}  // namespace

View viewFromName(std::string_view name) {
  static const std::array<std::string, 3> kNames{"headset", "recorder", "spectator"};
  const auto found = std::find(kNames.begin(), kNames.end(), name);
  if (found == kNames.end()) {
    throw InvalidArgument("view", "'" + std::string(name) + "'",
                          "one of " + listChoices(kNames) + didYouMean(name, kNames));
  }
  return static_cast<View>(found - kNames.begin());
}

/// What lives as long as a round. Members are destroyed in reverse order: the scene's components
/// hold references to the world and the session.
struct App::Round {
  Round(const TimeSettings& time, std::int64_t start_ns, render::ImageSize size)
      : session(device, sessionSettings(size)), scene(time), physics(scene) {
    scene.clock().restart(start_ns);
  }

  xr::SimulatedDevice device;
  xr::Session session;
  scene::Scene scene;
  physics::PhysicsWorld physics;
  rl::SoundLog sounds;
  rl::RLEnv* env = nullptr;
};

App::App(AppSettings settings, std::shared_ptr<render::Renderer> renderer,
         std::span<std::uint8_t> image)
    : settings_(std::move(settings)),
      renderer_(std::move(renderer)),
      game_(games::createGame(settings_.game)),
      image_(image) {
  render::checkImageSize(settings_.headset_size);
  settings_.time.validate();
  settings_.options_json = mergedOptions("{}", settings_.options_json);
  configureGame(*game_, settings_.options_json);
  if (!settings_.log_dir.empty()) {
    logger_ = std::make_unique<rl::EpisodeLogger>(settings_.log_dir);
  }
  const std::size_t bytes = settings_.headset_size.pixels() * 4;
  if (image_.empty()) {
    own_image_.resize(bytes);
    image_ = own_image_;
  }
  if (image_.size() != bytes) {
    throw InvalidArgument("image", std::to_string(image_.size()) + " bytes",
                          std::to_string(bytes) + ", height x width x 4");
  }
}

App::~App() = default;

App::Round& App::round(std::string_view call) {
  if (round_ == nullptr) {
    throw StateError(std::string(call) + ": no round was started; call reset first");
  }
  return *round_;
}

void App::beginRound(std::uint32_t seed, std::int64_t start_ns, rl::EpisodeLogger* logger) {
  seed_ = seed;
  round_.reset();
  auto fresh = std::make_unique<Round>(settings_.time, start_ns, settings_.headset_size);
  rl::GameContext context{.scene = fresh->scene,
                          .xr = fresh->session,
                          .physics = fresh->physics,
                          .seed = seed,
                          .logger = logger,
                          .sounds = fresh->sounds};
  fresh->env = &game_->build(context);
  if (!fresh->session.attached()) fresh->session.attachActionSets();
  round_ = std::move(fresh);
}

StepResult App::reset(const RoundStart& start, const xr::DeviceState& devices) {
  return shown(begin(start, devices));
}

StepResult App::step(std::span<const FrameInput> frames) { return shown(advance(frames)); }

Outcome App::begin(const RoundStart& start, const xr::DeviceState& devices) {
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
  beginRound(start.seed, start.time_ns, logger_.get());
  round_->session.begin();
  runFrame(start.time_ns, checked);
  return outcome(round_->env->reward());
}

Outcome App::advance(std::span<const FrameInput> frames) {
  Round& current = round("step");
  if (current.env->finished()) {
    throw StateError("step: the round is over; call reset to start the next one");
  }
  if (frames.empty()) throw InvalidArgument("frames", "none", "at least one frame");
  std::vector<xr::DeviceState> checked;
  checked.reserve(frames.size());
  std::int64_t previous_ns = current.session.frameTime();
  for (const FrameInput& frame : frames) {
    checked.push_back(xr::validated(frame.devices));
    if (frame.time_ns < previous_ns) {
      throw InvalidArgument("time_ns", std::to_string(frame.time_ns),
                            "a time not before the previous frame's " +
                                std::to_string(previous_ns) + " (clocks must not go backwards)");
    }
    previous_ns = frame.time_ns;
  }
  current.env->setFramesPerStep(static_cast<int>(frames.size()));
  float reward = 0.0F;
  for (std::size_t i = 0; i < frames.size() && !current.env->finished(); ++i) {
    runFrame(frames[i].time_ns, checked[i]);
    reward += current.env->reward();
  }
  return outcome(reward);
}

void App::runFrame(std::int64_t time_ns, const xr::DeviceState& devices) {
  Round& current = *round_;
  const auto period = static_cast<XrDuration>(kNsPerSecond / settings_.time.target_frame_rate);
  current.device.set(devices);
  current.session.waitFrame(time_ns, period);
  current.session.beginFrame();
  current.session.syncActions();
  current.scene.runFrame(time_ns, [&current] { current.physics.step(); });
  current.session.endFrame();
  if (logger_ != nullptr && current.env->finished()) logger_->endRound();
}

Outcome App::outcome(float reward) {
  events_ = {round_->device.takePulses(), round_->sounds.take()};
  const rl::RLEnv& env = *round_->env;
  return {reward, env.finished(), env.GetTimeFeature()};
}

StepResult App::shown(const Outcome& outcome) {
  renderView(View::headset, settings_.headset_size, image_);
  return {outcome.reward, outcome.finished, outcome.time_feature, log(), events_};
}

std::optional<double> App::headRequest(const RoundStart& start) const {
  const std::unique_ptr<rl::Game> game = games::createGame(settings_.game);
  configureGame(*game, mergedOptions(settings_.options_json, start.options_json));
  return game->headRequest(start.seed);
}

const std::map<std::string, double>& App::log() {
  const rl::RLEnv& env = *round("log").env;
  return env.log();
}

void App::fillPrivileged(std::span<float> values) {
  if (values.size() != privilegedNames().size()) {
    throw InvalidArgument("values", std::to_string(values.size()) + " numbers",
                          std::to_string(privilegedNames().size()));
  }
  round("fillPrivileged").env->fillPrivileged(values);
}

void App::renderView(View view, render::ImageSize size, std::span<std::uint8_t> rgba) {
  const render::ViewRequest request = viewRequest(view, size, rgba);
  renderer_->render(request.scene, request.camera, request.size, request.rgba);
}

render::ViewRequest App::viewRequest(View view, render::ImageSize size,
                                     std::span<std::uint8_t> rgba) {
  static constexpr std::array<std::string_view, 3> kPaths{
      rl::kHeadCameraPath, rl::kThirdPersonCameraPath, rl::kSpectatorCameraPath};
  Round& current = round("renderView");
  const std::string_view path = kPaths.at(static_cast<std::size_t>(view));
  const scene::GameObject* object = current.scene.find(path);
  const auto* camera = object == nullptr ? nullptr : object->getComponent<render::Camera>();
  if (camera == nullptr) {
    throw InvalidArgument("view", "one without a camera",
                          "a camera at '" + std::string(path) + "' in the game's scene");
  }
  return {current.scene, *camera, size, rgba};
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
    beginRound(seed_, 0, nullptr);
  }
  archive.field("carried", *game_);
  archive.field("scene", round_->scene);
  archive.field("physics", round_->physics);
  archive.field("session", round_->session);
}

std::string App::save() {
  round("save");
  Archive archive = Archive::saver();
  fields(archive);
  return archive.bytes();
}

void App::load(const std::string& state) {
  const std::string options = settings_.options_json;
  try {
    try {
      Archive archive = Archive::loader(state);
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
  renderView(View::headset, settings_.headset_size, image_);
}

std::uint64_t App::stateHash() {
  round("stateHash");
  Archive archive = Archive::saver();
  fields(archive);
  return archive.hash();
}

}  // namespace sim2vr::runtime

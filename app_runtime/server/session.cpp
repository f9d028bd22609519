// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/server/session.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <exception>
#include <new>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/core/options.hpp"
#include "sim2vr/core/text.hpp"
#include "sim2vr/core/version.hpp"
#include "sim2vr/render/image_io.hpp"
#include "sim2vr/runtime/thread_pool.hpp"
#include "sim2vr/server/protocol1.hpp"
#include "sim2vr/wire/shared_images.hpp"

namespace sim2vr::server {
namespace {

/// Paces frames against the wall clock, for people who watch. Lockstep itself needs none.
class FrameScheduler {
 public:
  /// `time_scale`: game seconds per wall-clock second.
  FrameScheduler(bool enabled, double time_scale) : enabled_(enabled), time_scale_(time_scale) {}

  /// The frame at `time_ns` is shown now.
  void restart(std::int64_t time_ns);
  /// Returns when the frame at `time_ns` is due, after a second of wall-clock time at most. A delay
  /// of more than 0.1 s is not caught up.
  void waitFor(std::int64_t time_ns);

 private:
  using Clock = std::chrono::steady_clock;

  bool enabled_;
  double time_scale_;
  std::int64_t shown_ns_ = 0;
  Clock::time_point shown_at_{};
};

void FrameScheduler::restart(std::int64_t time_ns) {
  shown_ns_ = time_ns;
  shown_at_ = Clock::now();
}

void FrameScheduler::waitFor(std::int64_t time_ns) {
  if (!enabled_) return;
  const double wait_ns = static_cast<double>(time_ns - shown_ns_) / time_scale_;
  const auto wait = std::chrono::nanoseconds(std::int64_t(std::clamp(wait_ns, 0.0, 1e9)));
  const Clock::time_point due = shown_at_ + wait;
  std::this_thread::sleep_until(due);
  shown_ns_ = time_ns;
  shown_at_ = std::max(due, Clock::now() - std::chrono::milliseconds(100));
}

/// A session of protocol 1: one app, the reference's order of messages and clocks.
class Session1 final : public Session {
 public:
  /// Throws as decodeHandshake and runtime::App do.
  Session1(AppHost& host, std::string_view handshake);

  /// Answer to the handshake.
  Reply greeting() const;
  Reply answer(Frames body) override;
  bool over() const override { return over_; }

 private:
  Reply answerState(const protocol1::State& state);
  runtime::StepResult play(const protocol1::State& state);
  runtime::StepResult reset(const protocol1::State& state);
  runtime::StepResult step(const protocol1::State& state);
  void checkClock(const protocol1::State& state) const;
  std::int64_t gameTimeNs(double user_time_s) const;
  void addExtensions(const protocol1::State& state, protocol1::Observation& observation);
  /// How the session holds the head in the round that begins; none: as the user does.
  std::optional<double> headPitch_deg(const runtime::RoundStart& start);

  AppHost& host_;
  protocol1::Handshake handshake_;
  protocol1::FrameTime frame_time_;
  protocol1::ClockOrigin clock_;
  protocol1::HeadRotation head_rotation_;
  std::unique_ptr<HostedApp> app_;
  FrameScheduler scheduler_;
  /// headPitch_deg of the round.
  std::optional<double> head_pitch_deg_;
  /// The user's clock at the start of the round, where the game clock restarts with each round.
  double origin_s_ = 0.0;
  /// The user's clock in its latest State; none before the first.
  std::optional<double> latest_s_;
  bool ended_by_user_ = false;
  bool over_ = false;
};

/// A frame at the user's rate must not be cut short by the limit on frame lengths.
constexpr double kLongestFrame_periods = 1.5;

std::string single(std::string_view what, Frames body) {
  if (body.size() == 1) return std::string(body[0]);
  throw MalformedMessage(std::string(what) + ": got " + std::to_string(body.size()) +
                         " frames, expected one of JSON text");
}

runtime::AppSettings appSettings(const HostSettings& host, const protocol1::Handshake& handshake) {
  runtime::AppSettings settings = host.app;
  settings.time.fixed_delta_time_s = handshake.fixedStep_s();
  settings.time.target_frame_rate = handshake.sample_frequency_hz;
  settings.time.time_scale = handshake.time_scale;
  settings.time.maximum_delta_time_s = std::max(
      settings.time.maximum_delta_time_s, kLongestFrame_periods / handshake.sample_frequency_hz);
  return settings;
}

double timeScale(const HostSettings& host, const protocol1::Handshake& handshake) {
  return host.time_scale > 0.0 ? host.time_scale : handshake.time_scale;
}

/// The devices as the app shall see them: with the head turned to `pitch_deg`, up positive, where
/// it is. A rotation that is missing stays so, and is refused.
xr::DeviceState devices(TrackedPoses poses, std::optional<double> pitch_deg) {
  const bool given = std::any_of(poses.head.begin() + 3, poses.head.end(),
                                 [](double number) { return number != 0.0; });
  if (pitch_deg && given) {
    // About Unity's x axis, which points right: a positive angle looks down.
    const double half_rad = -0.5 * *pitch_deg * std::numbers::pi / 180.0;
    const std::array<double, 4> rotation{std::sin(half_rad), 0.0, 0.0, std::cos(half_rad)};
    std::copy(rotation.begin(), rotation.end(), poses.head.begin() + 3);
  }
  return poses.devices();
}

Session1::Session1(AppHost& host, std::string_view handshake)
    : host_(host),
      handshake_(protocol1::decodeHandshake(handshake)),
      frame_time_(handshake_.frame_time.value_or(host.settings().frame_time)),
      clock_(handshake_.clock.value_or(host.settings().clock)),
      head_rotation_(handshake_.head_rotation.value_or(protocol1::HeadRotation::app)),
      app_(std::move(
          host.makeApps(appSettings(host.settings(), handshake_), host.settings().renderer, 1)
              .front())),
      scheduler_(host.settings().realtime, timeScale(host.settings(), handshake_)) {
  logger().info("protocol 1: {} states per second, fixed step {} s, {} frame time, {} clock",
                handshake_.sample_frequency_hz, handshake_.fixedStep_s(),
                frame_time_ == protocol1::FrameTime::next ? "next" : "current",
                clock_ == protocol1::ClockOrigin::absolute ? "absolute" : "round");
}

Reply Session1::greeting() const {
  protocol1::Observation observation;
  observation.time_feature = -1.0F;
  observation.log_json = "null";
  if (handshake_.knowsUs()) {
    observation.server = "sim2vr-app " + std::string(version());
  }
  return {protocol1::encodeObservation(observation)};
}

Reply Session1::answer(Frames body) {
  try {
    if (protocol2::isProtocol2(body)) {
      throw StateError("message: got one of protocol 2, this session speaks protocol 1");
    }
    return answerState(protocol1::decodeState(single("state", body)));
  } catch (...) {
    return errorReply(body, currentProblem());
  }
}

Reply Session1::answerState(const protocol1::State& state) {
  protocol1::Observation observation;
  if (state.quit) {
    over_ = true;
    observation.finished = true;
    return {protocol1::encodeObservation(observation)};
  }
  if (state.is_handshake) {
    throw StateError("handshake: got a second one, expected a state; connect anew to start over");
  }
  bool shows_image = !state.query_only;
  if (state.load) {
    app_->app().load(*state.load);
    latest_s_.reset();
    ended_by_user_ = false;
    shows_image = true;
  } else if (!state.query_only) {
    const runtime::StepResult result = play(state);
    observation.finished = result.finished || state.finished;
    observation.reward = result.reward;
    observation.time_feature = result.time_feature;
    observation.log_json = protocol1::logText(result.log);
  }
  if (shows_image) {
    const runtime::LockstepApp& app = app_->app();
    observation.png = render::encodePng(app.settings().headset_size, app.image());
  }
  addExtensions(state, observation);
  return {protocol1::encodeObservation(observation)};
}

void Session1::addExtensions(const protocol1::State& state, protocol1::Observation& observation) {
  runtime::LockstepApp& app = app_->app();
  if (state.head_request) {
    const auto& [seed, options] = *state.head_request;
    observation.head_request_json =
        protocol2::encodeHeadRequest(app.headRequest({.seed = seed, .options_json = options}));
  }
  if (state.wants_hash) observation.state_hash = app.stateHash();
  if (state.wants_save) observation.saved_state = app.save();
  if (state.render) {
    observation.picture_png =
        render::encodePng(state.render->size, drawPicture(app, *state.render));
  }
}

runtime::StepResult Session1::play(const protocol1::State& state) {
  checkClock(state);
  runtime::StepResult result = state.reset ? reset(state) : step(state);
  latest_s_ = state.current_s;
  ended_by_user_ = state.finished;
  return result;
}

runtime::StepResult Session1::reset(const protocol1::State& state) {
  const bool restarts = clock_ == protocol1::ClockOrigin::round;
  const std::int64_t time_ns = state.time_ns.value_or(
      restarts ? 0 : frameTimeNs(state.current_s, handshake_.sample_frequency_hz));
  const std::uint32_t seed = state.seed ? *state.seed : host_.nextSeed();
  const runtime::RoundStart start{seed, state.options_json, time_ns};
  const std::optional<double> pitch_deg = headPitch_deg(start);
  runtime::StepResult result = app_->reset(start, devices(state.poses, pitch_deg));
  head_pitch_deg_ = pitch_deg;
  origin_s_ = restarts ? state.current_s : 0.0;
  logger().info("round with seed {} at {} s", seed, static_cast<double>(time_ns) * 1e-9);
  scheduler_.restart(time_ns);
  return result;
}

runtime::StepResult Session1::step(const protocol1::State& state) {
  if (ended_by_user_) {
    throw StateError("step: the round is over (the user's isFinished); send a reset or quit");
  }
  std::vector<runtime::FrameInput> frames;
  for (const TimedPoses& frame : state.frames) {
    frames.push_back({frame.time_ns, devices(frame.poses, head_pitch_deg_)});
  }
  if (frames.empty()) {
    const bool next = frame_time_ == protocol1::FrameTime::next;
    const std::int64_t time_ns =
        state.time_ns ? *state.time_ns : gameTimeNs(next ? state.next_s : state.current_s);
    frames.push_back({time_ns, devices(state.poses, head_pitch_deg_)});
  }
  runtime::StepResult result = app_->step(frames);
  scheduler_.waitFor(frames.back().time_ns);
  return result;
}

std::optional<double> Session1::headPitch_deg(const runtime::RoundStart& start) {
  const bool asks = head_rotation_ == protocol1::HeadRotation::app &&
                    app_->app().can(runtime::Capability::head_request);
  return asks ? app_->app().headRequest(start) : std::nullopt;
}

void Session1::checkClock(const protocol1::State& state) const {
  if (state.time_ns || !state.frames.empty()) return;  // the app checks those
  const bool same_clock = !state.reset || clock_ == protocol1::ClockOrigin::absolute;
  if (same_clock && latest_s_ && state.current_s < *latest_s_) {
    throw InvalidArgument("currentTimestep", std::to_string(state.current_s),
                          "a time not before the previous state's " + std::to_string(*latest_s_) +
                              " (clocks must not go backwards)");
  }
  const bool uses_next = !state.reset && frame_time_ == protocol1::FrameTime::next;
  if (uses_next && state.next_s < state.current_s) {
    throw InvalidArgument("nextTimestep", std::to_string(state.next_s),
                          "a time not before currentTimestep " + std::to_string(state.current_s));
  }
}

std::int64_t Session1::gameTimeNs(double user_time_s) const {
  return frameTimeNs(user_time_s - origin_s_, handshake_.sample_frequency_hz);
}

/// A session of protocol 2: several apps, batched messages.
class Session2 final : public Session {
 public:
  explicit Session2(AppHost& host);

  Reply answer(Frames body) override;
  bool over() const override { return over_; }
  /// False until a hello was answered.
  bool open() const { return !apps_.empty(); }

 private:
  using Header = protocol2::Header;

  Reply answerRequest(const Header& header, const protocol2::Request& request);
  Reply respond(const Header& header, const protocol2::Hello& hello);
  Reply respond(const Header& header, const protocol2::Reset& reset);
  Reply respond(const Header& header, const protocol2::Step& step);
  Reply respond(const Header& header, const PictureRequest& picture);
  Reply respond(const Header& header, const protocol2::Save& save);
  Reply respond(const Header& header, const protocol2::Load& load);
  Reply respond(const Header& header, const protocol2::Hash& hash);
  Reply respond(const Header& header, const protocol2::Quit& quit);
  Reply respond(const Header& header, const protocol2::HeadRequest& request);
  Reply respond(const Header& header, const protocol2::SceneRequest& request);
  runtime::AppSettings appSettings(const protocol2::Hello& hello) const;
  /// The answer to hello: what the session is.
  std::string about(const runtime::AppSettings& settings) const;
  /// Plays the records, those of different workers at the same time. A record that fails leaves its
  /// app as it was.
  template <class Record>
  Reply playAll(const Header& header, const std::vector<Record>& records);
  void checkApps(const std::vector<std::uint32_t>& indices) const;
  void addImages(const std::vector<protocol2::Result>& results, Reply& reply);
  HostedApp& app(std::uint32_t index);

  runtime::StepResult play(const protocol2::ResetRecord& record);
  runtime::StepResult play(const protocol2::StepRecord& record);
  void pace(const protocol2::ResetRecord& record);
  void pace(const protocol2::StepRecord& record);

  AppHost& host_;
  std::vector<std::unique_ptr<HostedApp>> apps_;
  std::unique_ptr<wire::SharedImages> shared_;
  runtime::ThreadPool workers_;
  protocol2::Names names_;
  /// What comes back is what the client can take.
  bool sends_haptics_ = true;
  bool sends_sounds_ = true;
  FrameScheduler scheduler_;
  bool over_ = false;
};

using protocol2::Result;
using protocol2::Status;

constexpr std::size_t kMaximumImageBytes = std::size_t{512} << 20;

void checkMemory(const runtime::AppSettings& settings, std::uint32_t apps) {
  render::checkImageSize(settings.headset_size);
  if (settings.imageBytes() * apps <= kMaximumImageBytes) return;
  const render::ImageSize size = settings.headset_size;
  throw InvalidArgument("apps",
                        std::to_string(apps) + " of " + std::to_string(size.width) + " x " +
                            std::to_string(size.height) + " pixels",
                        std::to_string(kMaximumImageBytes >> 20) + " MiB of images at most");
}

/// Of hello's list; a client that sends none takes everything.
bool takes(const protocol2::Hello& hello, runtime::Capability capability) {
  if (!hello.capabilities) return true;
  const std::string_view name = runtime::capabilityName(capability);
  return std::find(hello.capabilities->begin(), hello.capabilities->end(), name) !=
         hello.capabilities->end();
}

/// Names of what the app can do over this protocol, which has no message for privileged numbers.
std::vector<std::string> capabilityNames(const runtime::LockstepApp& app) {
  std::vector<std::string> names;
  for (const runtime::Capability capability : app.capabilities()) {
    if (capability != runtime::Capability::privileged) {
      names.emplace_back(runtime::capabilityName(capability));
    }
  }
  return names;
}

std::string asString(std::span<const std::uint8_t> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

Session2::Session2(AppHost& host)
    : host_(host),
      workers_(host.settings().threads),
      scheduler_(host.settings().realtime,
                 host.settings().time_scale > 0.0 ? host.settings().time_scale : 1.0) {}

Reply Session2::answer(Frames body) {
  Header header;
  try {
    if (!protocol2::isProtocol2(body)) {
      throw StateError("message: got one of protocol 1, this session speaks protocol 2");
    }
    header = protocol2::decodeHeader(body[0]);
    if (header.version != protocol2::kVersion) {
      return protocol2::encodeOtherVersion(header);
    }
    return answerRequest(header, protocol2::decodeRequest(header, body));
  } catch (...) {
    return errorReply(body, currentProblem());
  }
}

Reply Session2::answerRequest(const Header& header, const protocol2::Request& request) {
  if (!open() && !std::holds_alternative<protocol2::Hello>(request)) {
    throw StateError("message: got one before hello, expected hello first");
  }
  return std::visit([&](const auto& asked) { return respond(header, asked); }, request);
}

Reply Session2::respond(const Header& header, const protocol2::Reset& reset) {
  return playAll(header, reset.records);
}

Reply Session2::respond(const Header& header, const protocol2::Step& step) {
  return playAll(header, step.records);
}

Reply Session2::respond(const Header& header, const PictureRequest& picture) {
  return protocol2::encodeReply(header, asString(drawPicture(app(picture.app).app(), picture)));
}

Reply Session2::respond(const Header& header, const protocol2::Save& save) {
  return protocol2::encodeReply(header, app(save.app).app().save());
}

Reply Session2::respond(const Header& header, const protocol2::Load& load) {
  runtime::LockstepApp& loaded = app(load.app).app();
  loaded.load(load.state);
  if (shared_ != nullptr) shared_->write(load.app, loaded.image());
  return protocol2::encodeReply(header, asString(loaded.image()));
}

Reply Session2::respond(const Header& header, const protocol2::Hash& hash) {
  const std::uint64_t value = app(hash.app).app().stateHash();
  return protocol2::encodeReply(header, protocol2::encodeHash(value));
}

Reply Session2::respond(const Header& header, const protocol2::Quit&) {
  over_ = true;
  return protocol2::encodeReply(header);
}

Reply Session2::respond(const Header& header, const protocol2::HeadRequest& request) {
  const std::optional<double> pitch_deg =
      app(request.app)
          .app()
          .headRequest({.seed = request.seed, .options_json = request.options_json});
  return protocol2::encodeReply(header, protocol2::encodeHeadRequest(pitch_deg));
}

Reply Session2::respond(const Header& header, const protocol2::SceneRequest& request) {
  runtime::LockstepApp& asked = app(request.app).app();
  const std::vector<render::Shown> shown = asked.shown();
  int known = 0;
  for (const render::Shown& each : shown) known = std::max(known, each.mesh + 1);
  std::vector<const render::Mesh*> new_meshes;
  for (int number = request.meshes; number < known; ++number) {
    new_meshes.push_back(&asked.shownMesh(number));
  }
  return protocol2::encodeScene(header, shown, new_meshes);
}

runtime::AppSettings Session2::appSettings(const protocol2::Hello& hello) const {
  runtime::AppSettings settings = host_.settings().app;
  const bool other_game = hello.game && *hello.game != settings.game;
  if (other_game) {
    settings.game = *hello.game;
    settings.options_json = "{}";
  }
  settings.options_json = mergedOptions(settings.options_json, hello.options_json);
  settings.headset_size = {hello.width.value_or(settings.headset_size.width),
                           hello.height.value_or(settings.headset_size.height)};
  settings.eyes = hello.eyes.value_or(settings.eyes);
  if (hello.ipd_m) settings.ipd_m = static_cast<float>(*hello.ipd_m);
  if (hello.log_dir && !hello.log_dir->empty()) {
    if (!host_.settings().local) {
      throw InvalidArgument("log_dir", "'" + *hello.log_dir + "' from another machine",
                            "none; the server's --log-dir writes logs");
    }
    settings.log_dir = pathFromUri("log_dir", *hello.log_dir);
  }
  TimeSettings& time = settings.time;
  time.fixed_delta_time_s = hello.fixed_delta_time_s.value_or(time.fixed_delta_time_s);
  time.maximum_delta_time_s = hello.maximum_delta_time_s.value_or(time.maximum_delta_time_s);
  time.fixed_step_tolerance_s = hello.fixed_step_tolerance_s.value_or(time.fixed_step_tolerance_s);
  return settings;
}

Reply Session2::respond(const Header& header, const protocol2::Hello& hello) {
  const runtime::AppSettings settings = appSettings(hello);
  const std::string kind = hello.renderer.value_or(host_.settings().renderer);
  checkMemory(settings, hello.apps);
  std::vector<std::unique_ptr<HostedApp>> apps = host_.makeApps(settings, kind, hello.apps);
  std::unique_ptr<wire::SharedImages> shared;
  if (hello.shared_memory && host_.settings().local) {
    shared = wire::SharedImages::create(apps.size(), settings.imageBytes());
  }
  apps_ = std::move(apps);
  shared_ = std::move(shared);
  names_ = {};
  sends_haptics_ = takes(hello, runtime::Capability::haptics);
  sends_sounds_ = takes(hello, runtime::Capability::sounds);
  logger().info("protocol 2: {} for {}, {} app(s), images through {}", settings.game,
                printable(hello.client), apps_.size(),
                shared_ != nullptr ? "shared memory" : "the socket");
  return protocol2::encodeReply(header, about(settings));
}

std::string Session2::about(const runtime::AppSettings& settings) const {
  runtime::LockstepApp& app = apps_.front()->app();
  nlohmann::json facts;
  if (const auto& tell = host_.settings().facts_json) {
    facts = nlohmann::json::parse(tell(settings.game));
  }
  nlohmann::json shared;
  if (shared_ != nullptr) shared = {{"path", shared_->path()}, {"link", shared_->link()}};
  const nlohmann::json json{{"server", "sim2vr-app"},
                            {"version", version()},
                            {"game", settings.game},
                            {"facts", std::move(facts)},
                            {"capabilities", capabilityNames(app)},
                            {"apps", apps_.size()},
                            {"width", settings.headset_size.width},
                            {"height", settings.headset_size.height},
                            {"eyes", settings.eyes},
                            {"renderer_description", app.rendererDescription()},
                            {"shared_memory", std::move(shared)}};
  return json.dump();
}

HostedApp& Session2::app(std::uint32_t index) {
  checkApps({index});
  return *apps_[index];
}

void Session2::checkApps(const std::vector<std::uint32_t>& indices) const {
  std::vector<bool> seen(apps_.size(), false);
  for (const std::uint32_t index : indices) {
    if (index >= apps_.size()) {
      throw InvalidArgument("app", std::to_string(index),
                            "0 to " + std::to_string(apps_.size() - 1));
    }
    if (seen[index]) {
      throw InvalidArgument("app", std::to_string(index) + " twice", "each app once in a message");
    }
    seen[index] = true;
  }
}

runtime::StepResult Session2::play(const protocol2::ResetRecord& record) {
  checkGameTime(record.time_ns);
  return apps_[record.app]->reset({record.seed, record.options_json, record.time_ns},
                                  record.poses.devices());
}

runtime::StepResult Session2::play(const protocol2::StepRecord& record) {
  return apps_[record.app]->step(frameInputs(record.frames), record.drawn);
}

template <class Record>
Reply Session2::playAll(const Header& header, const std::vector<Record>& records) {
  std::vector<std::uint32_t> indices;
  for (const Record& record : records) indices.push_back(record.app);
  checkApps(indices);
  std::vector<Result> results(records.size());
  workers_.run([&](int worker) {
    for (std::size_t i = 0; i < records.size(); ++i) {
      const std::uint32_t app = records[i].app;
      if (static_cast<int>(app) % workers_.threads() != worker) continue;
      results[i].app = app;
      try {
        results[i].step = play(records[i]);
        if (!sends_haptics_) results[i].step.events.haptics.clear();
        if (!sends_sounds_) results[i].step.events.sounds.clear();
      } catch (...) {
        const Problem problem = currentProblem();
        results[i].status = problem.status;
        results[i].error = problem.message;
      }
    }
  });
  if (!records.empty()) pace(records.front());
  Reply reply = protocol2::encodeResults(header, results, names_);
  addImages(results, reply);
  return reply;
}

void Session2::pace(const protocol2::ResetRecord& record) { scheduler_.restart(record.time_ns); }

void Session2::pace(const protocol2::StepRecord& record) {
  if (!record.frames.empty()) scheduler_.waitFor(record.frames.back().time_ns);
}

void Session2::addImages(const std::vector<Result>& results, Reply& reply) {
  if (shared_ != nullptr) {
    for (const Result& result : results) {
      shared_->write(result.app, apps_[result.app]->app().image());
    }
    Header header = protocol2::decodeHeader(reply[0]);
    header.flags |= protocol2::kImagesShared;
    reply[0] = protocol2::encodeHeader(header);
    return;
  }
  std::string& images = reply[protocol2::kImagesFrame];
  for (const Result& result : results) {
    const auto image = apps_[result.app]->app().image();
    images.append(reinterpret_cast<const char*>(image.data()), image.size());
  }
}

using protocol2::Status;

Opening openSession1(AppHost& host, Frames body) {
  try {
    if (body.size() != 1) {
      throw MalformedMessage("handshake: got " + std::to_string(body.size()) +
                             " frames, expected one of JSON text");
    }
    auto session = std::make_unique<Session1>(host, body[0]);
    Reply greeting = session->greeting();
    return {std::move(session), std::move(greeting), ""};
  } catch (...) {
    const Problem problem = currentProblem();
    return {nullptr, errorReply(body, problem), problem.message};
  }
}

Opening openSession2(AppHost& host, Frames body) {
  auto session = std::make_unique<Session2>(host);
  Reply reply = session->answer(body);
  if (session->open()) return {std::move(session), std::move(reply), ""};
  std::string refusal = reply.at(1);
  return {nullptr, std::move(reply), std::move(refusal)};
}

}  // namespace

Opening openSession(AppHost& host, Frames body) {
  return protocol2::isProtocol2(body) ? openSession2(host, body) : openSession1(host, body);
}

Problem currentProblem() {
  try {
    throw;
  } catch (const MalformedMessage& error) {
    return {Status::malformed_message, error.what()};
  } catch (const InvalidArgument& error) {
    return {Status::invalid_argument, error.what()};
  } catch (const runtime::Unsupported& error) {
    return {Status::unsupported, error.what()};
  } catch (const StateError& error) {
    return {Status::state_error, error.what()};
  } catch (const std::bad_alloc&) {
    return {Status::engine_error, "out of memory"};
  } catch (const std::exception& error) {
    return {Status::engine_error, error.what()};
  }
}

std::string statusName(Status status) {
  switch (status) {
    case Status::ok:
      return "ok";
    case Status::invalid_argument:
      return "invalid_argument";
    case Status::state_error:
      return "state_error";
    case Status::engine_error:
      return "engine_error";
    case Status::malformed_message:
      return "malformed_message";
    case Status::busy:
      return "busy";
    case Status::version_not_supported:
      return "version_not_supported";
    case Status::unsupported:
      return "unsupported";
  }
  return "?";
}

Reply errorReply(Frames body, const Problem& problem) {
  if (protocol2::isProtocol2(body)) {
    protocol2::Header header;
    try {
      header = protocol2::decodeHeader(body[0]);
    } catch (const MalformedMessage&) {
      // A header that cannot be read is answered with zeros.
    }
    return protocol2::encodeError(header, problem.status, problem.message);
  }
  protocol1::Observation observation;
  observation.finished = true;
  observation.error_code = statusName(problem.status);
  observation.error_message = problem.message;
  return {protocol1::encodeObservation(observation)};
}

}  // namespace sim2vr::server

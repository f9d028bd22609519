#include "session1.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/core/version.hpp"
#include "sim2vr/render/image_io.hpp"
#include "sim2vr/server/time_mapping.hpp"

namespace sim2vr::server {
namespace {

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

}  // namespace

Session1::Session1(AppHost& host, std::string_view handshake)
    : host_(host),
      handshake_(protocol1::decodeHandshake(handshake)),
      frame_time_(handshake_.frame_time.value_or(host.settings().frame_time)),
      clock_(handshake_.clock.value_or(host.settings().clock)),
      head_rotation_(handshake_.head_rotation.value_or(protocol1::HeadRotation::app)),
      app_(std::move(
          host.makeApps(appSettings(host.settings(), handshake_), host.settings().renderer, 1)
              .front())),
      pacer_(host.settings().realtime, timeScale(host.settings(), handshake_)) {
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
  pacer_.restart(time_ns);
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
  pacer_.waitFor(frames.back().time_ns);
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

}  // namespace sim2vr::server

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/server/protocol1.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/json_reader.hpp"

namespace sim2vr::server::protocol1 {
namespace {

using Json = nlohmann::json;

constexpr std::int64_t kMaximumFrequency_hz = 10'000;

/// {x, y, z} and {x, y, z, w}; what is missing is 0, as in Unity's reader.
PoseNumbers readPose(const JsonFields& message, const char* position, const char* rotation) {
  PoseNumbers pose{};
  if (const auto p = message.object(position)) {
    pose[0] = p->number("x", 0.0);
    pose[1] = p->number("y", 0.0);
    pose[2] = p->number("z", 0.0);
  }
  if (const auto q = message.object(rotation)) {
    pose[3] = q->number("x", 0.0);
    pose[4] = q->number("y", 0.0);
    pose[5] = q->number("z", 0.0);
    pose[6] = q->number("w", 0.0);
  }
  return pose;
}

constexpr PoseNumbers kMissing{};
constexpr PoseNumbers kOrigin{0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};

TrackedPoses readPoses(const JsonFields& message) {
  TrackedPoses poses;
  poses.head = readPose(message, "headsetPosition", "headsetRotation");
  poses.left = readPose(message, "leftControllerPosition", "leftControllerRotation");
  poses.right = readPose(message, "rightControllerPosition", "rightControllerRotation");
  poses.head_tracked = true;
  // The reference sends a left controller that it does not use as one at the origin.
  poses.left_tracked = poses.left != kMissing && poses.left != kOrigin;
  poses.right_tracked = poses.right != kMissing;
  return poses;
}

std::vector<TimedPoses> readFrames(const JsonFields& message) {
  std::vector<TimedPoses> frames;
  for (const JsonFields& frame : message.objects("frames")) {
    if (frames.size() == kMaximumFrames) {
      throw MalformedMessage("state.frames: got more, expected " + std::to_string(kMaximumFrames) +
                             " at most");
    }
    frames.push_back({frame.integer("time_ns", 0, 0, kLatest_ns), readPoses(frame)});
  }
  return frames;
}

int edge(const JsonFields& picture, const char* name, int fallback) {
  return static_cast<int>(picture.integer(name, fallback, 1, render::kMaxImageEdge));
}

std::uint32_t readSeed(const JsonFields& message) {
  return static_cast<std::uint32_t>(
      message.integer("seed", 0, 0, std::numeric_limits<std::uint32_t>::max()));
}

void readExtensions(const JsonFields& message, State& state) {
  if (message.has("seed")) state.seed = readSeed(message);
  state.options_json = message.objectText("options");
  if (message.has("timeNs")) state.time_ns = message.integer("timeNs", 0, 0, kLatest_ns);
  state.frames = readFrames(message);
  state.wants_hash = message.flag("stateHash");
  state.wants_save = message.flag("save");
  if (message.has("load")) state.load = decodeBase64(message.text("load", ""));
  if (const auto round = message.object("headRequest")) {
    state.head_request = {readSeed(*round), round->objectText("options")};
  }
  if (const auto picture = message.object("render")) {
    PictureRequest& request = state.render.emplace();
    request.view = picture->text("view", request.view);
    request.size = {edge(*picture, "width", request.size.width),
                    edge(*picture, "height", request.size.height)};
  }
}

/// "12,255,0": by table, since this is most of what the protocol does.
void appendBytes(std::string& text, std::string_view bytes) {
  static const std::array<std::string, 256> kNumbers = [] {
    std::array<std::string, 256> numbers;
    for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = std::to_string(i) + ",";
    return numbers;
  }();
  text.reserve(text.size() + 4 * bytes.size() + 2);
  text += '[';
  for (const char byte : bytes) text += kNumbers[static_cast<unsigned char>(byte)];
  if (text.back() == ',') text.pop_back();
  text += ']';
}

std::string jsonString(std::string_view text) {
  return Json(text).dump(-1, ' ', false, Json::error_handler_t::replace);
}

/// With the digits of the binary64 number of the same value, so that readers get it exactly.
std::string number(float value) { return Json(static_cast<double>(value)).dump(); }

}  // namespace

FrameTime frameTimeFromName(const std::string& field, const std::string& name) {
  if (name == "next") return FrameTime::next;
  if (name == "current") return FrameTime::current;
  throw InvalidArgument(field, "'" + name + "'", "'next' or 'current'");
}

ClockOrigin clockOriginFromName(const std::string& field, const std::string& name) {
  if (name == "absolute") return ClockOrigin::absolute;
  if (name == "round") return ClockOrigin::round;
  throw InvalidArgument(field, "'" + name + "'", "'absolute' or 'round'");
}

HeadRotation headRotationFromName(const std::string& field, const std::string& name) {
  if (name == "app") return HeadRotation::app;
  if (name == "device") return HeadRotation::device;
  throw InvalidArgument(field, "'" + name + "'", "'app' or 'device'");
}

namespace {

Handshake readHandshake(std::string_view text) {
  const Json json = parseJson(text, "handshake");
  const JsonFields message(json, "handshake");
  Handshake handshake;
  handshake.timestep_s = message.number("timestep", 0.0);
  handshake.sample_frequency_hz =
      static_cast<int>(message.integer("sampleFrequency", 0, 0, kMaximumFrequency_hz));
  handshake.time_scale = message.number("timeScale", 0.0);
  handshake.fixed_delta_time_s = message.number("fixedDeltaTime", 0.0);
  if (handshake.sample_frequency_hz < 1) {
    throw MalformedMessage(
        "handshake.sampleFrequency: got none or 0, expected states per second (the first message "
        "is the handshake: timestep, sampleFrequency, timeScale)");
  }
  if (!(handshake.fixedStep_s() > 0.0)) {
    throw MalformedMessage("handshake.timestep: got none or 0, expected seconds above 0");
  }
  if (!(handshake.time_scale > 0.0)) {
    throw MalformedMessage("handshake.timeScale: got none or 0, expected a number above 0");
  }
  if (message.has("frameTime")) {
    handshake.frame_time = frameTimeFromName("handshake.frameTime", message.text("frameTime", ""));
  }
  if (message.has("clock")) {
    handshake.clock = clockOriginFromName("handshake.clock", message.text("clock", ""));
  }
  if (message.has("headRotation")) {
    handshake.head_rotation =
        headRotationFromName("handshake.headRotation", message.text("headRotation", ""));
  }
  return handshake;
}

State readState(std::string_view text) {
  const Json json = parseJson(text, "state");
  const JsonFields message(json, "state");
  State state;
  state.poses = readPoses(message);
  state.current_s = message.number("currentTimestep", 0.0);
  state.next_s = message.number("nextTimestep", 0.0);
  state.reset = message.flag("reset");
  state.finished = message.flag("isFinished");
  state.quit = message.flag("quitApplication");
  readExtensions(message, state);
  const bool asks =
      state.wants_hash || state.wants_save || state.load || state.render || state.head_request;
  const bool has_poses = message.has("headsetPosition") || message.has("headsetRotation");
  state.query_only = asks && !has_poses && !state.reset && !state.quit;
  state.is_handshake = message.has("sampleFrequency");
  return state;
}

}  // namespace

Handshake decodeHandshake(std::string_view text) {
  return decoded([&] { return readHandshake(text); });
}

State decodeState(std::string_view text) {
  return decoded([&] { return readState(text); });
}

std::string encodeObservation(const Observation& observation) {
  std::string text = R"({"isFinished":)";
  text += observation.finished ? "true" : "false";
  text += R"(,"reward":)" + number(observation.reward);
  text += R"(,"image":)";
  appendBytes(text, observation.png);
  text += R"(,"timeFeature":)" + number(observation.time_feature);
  text += R"(,"logDict":)" + jsonString(observation.log_json);
  if (observation.server) text += R"(,"server":)" + jsonString(*observation.server);
  if (observation.state_hash) {
    text += fmt::format(R"(,"stateHash":"{:016x}")", *observation.state_hash);
  }
  if (observation.saved_state) {
    text += R"(,"state":")" + encodeBase64(*observation.saved_state) + '"';
  }
  if (!observation.picture_png.empty()) {
    text += R"(,"render":)";
    appendBytes(text, observation.picture_png);
  }
  if (!observation.head_request_json.empty()) {
    text += R"(,"headRequest":)" + observation.head_request_json;
  }
  if (!observation.error_code.empty()) {
    text += R"(,"error":{"code":)" + jsonString(observation.error_code) + R"(,"message":)" +
            jsonString(observation.error_message) + '}';
  }
  text += '}';
  return text;
}

std::string logText(const std::map<std::string, double>& log) {
  Json json = Json::object();
  for (const auto& [name, value] : log) {
    if (std::isfinite(value)) json[name] = value;
  }
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace sim2vr::server::protocol1

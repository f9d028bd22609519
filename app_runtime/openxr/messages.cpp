// SPDX-License-Identifier: Apache-2.0
#include "messages.hpp"

#include <fmt/format.h>

#include <array>
#include <nlohmann/json.hpp>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/json_reader.hpp"
#include "sim2vr/core/version.hpp"
#include "sim2vr/xr/pose_row.hpp"

namespace sim2vr::openxr {
namespace {

using nlohmann::json;
using wire::MalformedMessage;

constexpr double kMaximumRate_hz = 1000.0;
constexpr std::int64_t kMaximumSize = 4096;
constexpr XrTime kLatest_ns = 1'000'000'000'000'000'000;

/// What the program says of itself may be any bytes.
std::string dumped(const json& value) {
  return value.dump(-1, ' ', false, json::error_handler_t::replace);
}

std::string versionText(XrVersion version) {
  return fmt::format("{}.{}.{}", XR_VERSION_MAJOR(version), XR_VERSION_MINOR(version),
                     XR_VERSION_PATCH(version));
}

Config configFrom(const JsonFields& fields) {
  Config config;
  config.width = static_cast<std::uint32_t>(fields.integer("width", 120, 1, kMaximumSize));
  config.height = static_cast<std::uint32_t>(fields.integer("height", 80, 1, kMaximumSize));
  config.ipd_m = fields.number("ipd_m", config.ipd_m, 0.0, 0.2);
  config.vertical_fov_deg = fields.number("vertical_fov_deg", config.vertical_fov_deg, 1.0, 170.0);
  config.frame_rate_hz = fields.number("frame_rate_hz", config.frame_rate_hz, 1.0, kMaximumRate_hz);
  config.images = fields.flag("images", true);
  config.depth = fields.flag("depth");
  config.eyes = static_cast<std::uint32_t>(fields.integer("eyes", 2, 1, 2));
  if (fields.has("hands")) {
    config.left_hand = config.right_hand = false;
    for (const std::string& hand : fields.texts("hands")) {
      if (hand != "left" && hand != "right") {
        throw InvalidArgument(fields.path("hands"), "'" + hand + "'", "'left' and 'right'");
      }
      (hand == "left" ? config.left_hand : config.right_hand) = true;
    }
  }
  config.profile = fields.text("profile", config.profile);
  const std::string gate = fields.text("gate", "strict");
  if (gate != "strict" && gate != "pipelined") {
    throw InvalidArgument(fields.path("gate"), "'" + gate + "'", "'strict' or 'pipelined'");
  }
  config.pipelined = gate == "pipelined";
  config.timeout_s = fields.number("timeout_s", config.timeout_s, 0.01, 1e6);
  config.start_time_ns = fields.integer("start_time_ns", 1, 0, kLatest_ns);
  config.farthest_m = fields.number("farthest_m", config.farthest_m, 1e-3, 1e6);
  return config;
}

struct RawFrame {
  XrTime time_ns = 0;
  std::array<double, xr::kPoseRowNumbers> head{};
  std::array<std::array<double, xr::kPoseRowNumbers>, 2> hands{};
  std::array<std::array<double, xr::kInputRowNumbers>, 2> inputs{};
  std::array<bool, 2> tracked{};
};

RawFrame takeFrame(wire::Reader& reader) {
  RawFrame frame;
  frame.time_ns = reader.take<std::int64_t>();
  reader.take(frame.head);
  for (bool& tracked : frame.tracked) tracked = reader.take<std::uint8_t>() != 0;
  for (auto& hand : frame.hands) reader.take(hand);
  for (auto& inputs : frame.inputs) reader.take(inputs);
  return frame;
}

xr::DeviceState devicesOf(const RawFrame& frame) {
  std::array<xr::ControllerState, 2> inputs;
  for (const xr::Hand hand : xr::kHands) {
    const auto i = static_cast<std::size_t>(hand);
    if (frame.tracked[i]) inputs[i] = xr::inputsFromRow(hand, frame.inputs[i].data());
  }
  return xr::validated(
      xr::devicesFromRows(frame.head.data(), frame.tracked[0] ? frame.hands[0].data() : nullptr,
                          frame.tracked[1] ? frame.hands[1].data() : nullptr, inputs));
}

template <class Decode>
auto decoded(Decode decode) {
  try {
    return decode();
  } catch (const InvalidArgument& error) {
    throw MalformedMessage(error.what());
  }
}

json eventJson(const Event& event) {
  if (event.kind == "haptic") {
    return {{"kind", event.kind},
            {"hand", event.text},
            {"amplitude", event.amplitude},
            {"frequency_hz", event.frequency_hz},
            {"duration_ns", event.duration_ns},
            {"time_ns", event.time_ns}};
  }
  return {{"kind", event.kind},
          {event.kind == "state" ? "state" : "text", event.text},
          {"time_ns", event.time_ns}};
}

}  // namespace

Config decodeConfig(std::string_view body) {
  return decoded([&] {
    const json parsed = parseJson(body, "config", 1000);
    return configFrom(JsonFields(parsed, "config"));
  });
}

std::string decodeError(std::string_view body) {
  try {
    const json parsed = parseJson(body, "error", 1000);
    return JsonFields(parsed, "error").text("error", std::string(body));
  } catch (const InvalidArgument&) {
    return std::string(body.substr(0, 1000));
  }
}

Step decodeStep(std::string_view body) {
  wire::Reader reader(body);
  const auto count = reader.take<std::uint32_t>();
  if (count < 1 || count > kMaximumFrames) {
    throw MalformedMessage(
        fmt::format("step.frames: got {}, expected 1 to {}", count, kMaximumFrames));
  }
  constexpr std::size_t kFrameBytes =
      8 + 2 + 8 * (3 * xr::kPoseRowNumbers + 2 * xr::kInputRowNumbers);
  if (body.size() != 4 + count * kFrameBytes + 1) {
    throw MalformedMessage(fmt::format("step: got {} bytes, expected {} for {} frames", body.size(),
                                       4 + count * kFrameBytes + 1, count));
  }
  Step step;
  XrTime latest = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    const RawFrame raw = takeFrame(reader);
    if (raw.time_ns <= latest || raw.time_ns > kLatest_ns) {
      throw MalformedMessage(
          fmt::format("step.frames[{}].time: got {} ns, expected above {} and "
                      "up to {}",
                      i, raw.time_ns, latest, kLatest_ns));
    }
    latest = raw.time_ns;
    step.frames.push_back({raw.time_ns, decoded([&] { return devicesOf(raw); })});
  }
  step.image_wanted = reader.take<std::uint8_t>() != 0;
  return step;
}

std::string encodeHello(const Hello& hello) {
  return dumped({{"protocol", 2},
                 {"runtime_version", version()},
                 {"application", hello.application},
                 {"application_version", hello.application_version},
                 {"engine", hello.engine},
                 {"engine_version", hello.engine_version},
                 {"api_version", versionText(hello.api_version)},
                 {"extensions", hello.extensions},
                 {"pid", hello.pid}});
}

std::string encodeSession(const SessionFacts& facts) {
  return dumped({{"graphics", facts.graphics},
                 {"depth_layers", facts.depth_layers},
                 {"image_bytes", facts.image_bytes}});
}

std::string encodeAnswer(const Answer& answer) {
  json events = json::array();
  for (const Event& event : answer.events) events.push_back(eventJson(event));
  json body{{"events", std::move(events)},
            {"should_render", answer.should_render},
            {"layers", answer.layers}};
  if (!answer.note.empty()) body["note"] = answer.note;
  const std::string text = dumped(body);
  std::string bytes;
  wire::append(bytes, answer.frames_shown);
  wire::append<std::uint8_t>(bytes, answer.has_image ? 1 : 0);
  wire::append<std::uint8_t>(bytes, answer.has_depth ? 1 : 0);
  wire::append(bytes, static_cast<std::uint32_t>(text.size()));
  return bytes + text;
}

std::string encodeEnded(std::string_view reason, std::string_view call) {
  return dumped({{"reason", reason}, {"call", call}});
}

}  // namespace sim2vr::openxr

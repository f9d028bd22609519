// SPDX-License-Identifier: Apache-2.0
// What runtime and harness say to each other over the program's socket: u32 length, u8 kind, body;
// little-endian. Decoding throws wire::MalformedMessage.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "api.hpp"
#include "sim2vr/wire/numbers.hpp"
#include "sim2vr/xr/tracking.hpp"

namespace sim2vr::openxr {

inline constexpr std::uint32_t kMaximumMessageBytes = 1U << 20U;
inline constexpr std::uint32_t kMaximumFrames = 1000;

enum class MessageKind : std::uint8_t {
  hello = 1,
  config,
  session,
  accepted,
  step,
  answer,
  quit,
  ended,
  error
};

struct Message {
  MessageKind kind{};
  std::string body;
};

/// What the simulated headset is.
struct Config {
  std::uint32_t width = 1024;
  std::uint32_t height = 1024;
  double ipd_m = 0.064;
  double vertical_fov_deg = 90.0;
  double frame_rate_hz = 90.0;
  bool images = false;
  bool depth = false;
  std::uint32_t eyes = 2;
  bool left_hand = true;
  bool right_hand = true;
  std::string profile = "/interaction_profiles/oculus/touch_controller";
  bool pipelined = false;
  double timeout_s = 10.0;
  XrTime start_time_ns = 1;
  double farthest_m = 10.0;

  std::size_t eyeBytes() const { return static_cast<std::size_t>(width) * height * 4; }
  XrDuration period_ns() const { return static_cast<XrDuration>(1e9 / frame_rate_hz); }
  XrFovf fov() const { return xr::eyeFov(vertical_fov_deg, static_cast<double>(width) / height); }
};

/// Of the program, as it says itself.
struct Hello {
  std::string application;
  std::uint32_t application_version = 0;
  std::string engine;
  std::uint32_t engine_version = 0;
  XrVersion api_version = kVersion10;
  std::vector<std::string> extensions;
  std::int64_t pid = 0;
};

struct SessionFacts {
  std::string graphics;
  bool depth_layers = false;
  std::uint64_t image_bytes = 0;  // of the memory that comes with the message; 0: none
};

struct Step {
  std::vector<xr::Frame> frames;
  bool image_wanted = false;
};

struct Event {
  std::string kind;  // haptic, state, label
  std::string text;  // hand, state or label
  float amplitude = 0.0F;
  float frequency_hz = 0.0F;
  XrDuration duration_ns = 0;
  XrTime time_ns = 0;
};

struct Answer {
  std::uint32_t frames_shown = 0;
  bool has_image = false;
  bool has_depth = false;
  bool should_render = true;
  std::uint32_t layers = 0;
  std::vector<Event> events;
  std::string note;
};

Config decodeConfig(std::string_view body);
/// The "error" of an error message; the body as it is where it has none.
std::string decodeError(std::string_view body);
/// Poses become OpenXR's; frames have growing times above 0 (the caller checks them against the
/// previous step's).
Step decodeStep(std::string_view body);

std::string encodeHello(const Hello& hello);
std::string encodeSession(const SessionFacts& facts);
std::string encodeAnswer(const Answer& answer);
std::string encodeEnded(std::string_view reason, std::string_view call);

}  // namespace sim2vr::openxr

// SPDX-License-Identifier: Apache-2.0
// Protocol 1: the reference's messages, JSON text over REQ/REP, and our optional fields in them.
// docs/reference/protocol.md is the specification.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/server/message.hpp"

namespace sim2vr::server::protocol1 {

/// Where the frame that answers a State lies: at its nextTimestep, as in the reference (a reset's
/// at its currentTimestep), or always at its currentTimestep.
enum class FrameTime : std::uint8_t { next, current };
/// The game clock: the user's, over all rounds, as in the reference; or 0 at each reset.
enum class ClockOrigin : std::uint8_t { absolute, round };

/// Who turns the head as the app requests (runtime::LockstepApp::headRequest): the session, which
/// replaces the rotation that it is sent and keeps the position, as the reference's app does; or
/// the user, whose device counts.
enum class HeadRotation : std::uint8_t { app, device };

/// From "next" or "current", "absolute" or "round"; throws InvalidArgument naming `field`.
FrameTime frameTimeFromName(const std::string& field, const std::string& name);
ClockOrigin clockOriginFromName(const std::string& field, const std::string& name);
/// From "app" or "device".
HeadRotation headRotationFromName(const std::string& field, const std::string& name);

struct Handshake {
  double timestep_s = 0.0;
  int sample_frequency_hz = 0;
  double time_scale = 0.0;
  double fixed_delta_time_s = 0.0;
  // Ours.
  std::optional<FrameTime> frame_time;
  std::optional<ClockOrigin> clock;
  std::optional<HeadRotation> head_rotation;

  /// One of our fields is there.
  bool knowsUs() const { return frame_time || clock || head_rotation; }
  /// Period of the app's fixed steps, s.
  double fixedStep_s() const { return fixed_delta_time_s > 0.0 ? fixed_delta_time_s : timestep_s; }
};

struct State {
  TrackedPoses poses;
  double current_s = 0.0;
  double next_s = 0.0;
  bool reset = false;
  bool finished = false;
  bool quit = false;
  // Ours.
  std::optional<std::uint32_t> seed;
  std::string options_json = "{}";
  std::optional<std::int64_t> time_ns;
  std::vector<TimedPoses> frames;
  bool wants_hash = false;
  bool wants_save = false;
  std::optional<std::string> load;
  std::optional<PictureRequest> render;
  /// Of the round that this seed and these options would start.
  struct HeadRequest {
    std::uint32_t seed = 0;
    std::string options_json = "{}";
  };
  std::optional<HeadRequest> head_request;

  /// Without poses: it asks for, or replaces, the app's state, and moves nothing.
  bool query_only = false;
  /// It has the fields of a handshake.
  bool is_handshake = false;
};

/// Throws MalformedMessage.
Handshake decodeHandshake(std::string_view text);
State decodeState(std::string_view text);

/// A reply. `png` and `picture_png` are files' bytes; empty: none.
struct Observation {
  bool finished = false;
  float reward = 0.0F;
  std::string png;
  float time_feature = 0.0F;
  /// JSON text, which the message holds as a string.
  std::string log_json = "{}";
  // Ours.
  std::optional<std::string> server;
  std::optional<std::uint64_t> state_hash;
  std::optional<std::string> saved_state;
  std::string picture_png;
  /// JSON text.
  std::string head_request_json;
  std::string error_code;
  std::string error_message;
};

std::string encodeObservation(const Observation& observation);

/// The app's log as JSON text, without numbers that are not finite.
std::string logText(const std::map<std::string, double>& log);

}  // namespace sim2vr::server::protocol1

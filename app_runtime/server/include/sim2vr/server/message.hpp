// SPDX-License-Identifier: Apache-2.0
// What both protocols share: the one error of their decoders, and what the devices report.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/runtime/lockstep_app.hpp"
#include "sim2vr/wire/numbers.hpp"
#include "sim2vr/xr/device.hpp"
#include "sim2vr/xr/pose_row.hpp"

namespace sim2vr::server {

// Bytes as text (RFC 4648, with padding), for saved states in protocol 1.

std::string encodeBase64(std::string_view bytes);

/// Inverse of encodeBase64. Throws MalformedMessage for anything that encodeBase64 would not write.
std::string decodeBase64(std::string_view text);

// From a user's clock in seconds to game time in integer nanoseconds.

/// Game time at `time_s` on the clock of a user who sends `sample_frequency_hz` states per second.
/// Where time_s lies on the grid of states, n / sample_frequency_hz, it is
/// lockstepFrameTimeNs(n, sample_frequency_hz); elsewhere it is time_s rounded to a nanosecond.
/// "On the grid" means within 1e-6 + 1e-8 n periods: a clock that adds up 2 ms substeps in
/// binary64, as MuJoCo's does, is 2e-4 periods off after 10^6 states and must not drift against the
/// fixed steps. Throws InvalidArgument ("time") unless time_s is from 0 to 1e9.
std::int64_t frameTimeNs(double time_s, int sample_frequency_hz);

using wire::MalformedMessage;

/// What `decode` returns; what reading JSON finds wrong becomes a MalformedMessage.
template <class Decode>
auto decoded(Decode decode) {
  try {
    return decode();
  } catch (const InvalidArgument& error) {
    throw MalformedMessage(error.what());
  }
}

/// The body of a received message, without identity and delimiter.
using Frames = std::span<const std::string_view>;
/// The body of a reply.
using Reply = std::vector<std::string>;

/// Position x y z (m) and rotation x y z w in the app's frame.
using PoseNumbers = std::array<double, xr::kPoseRowNumbers>;
/// Triggers, buttons and the like of one controller, in the columns of xr::kInputColumns.
using InputNumbers = std::array<double, xr::kInputRowNumbers>;

/// Poses and inputs of one frame; the numbers of a device that is not tracked mean nothing.
struct TrackedPoses {
  PoseNumbers head{};
  PoseNumbers left{};
  PoseNumbers right{};
  InputNumbers left_inputs{};
  InputNumbers right_inputs{};
  bool head_tracked = false;
  bool left_tracked = false;
  bool right_tracked = false;

  /// Throws InvalidArgument when the head is not tracked, and as xr::inputsFromRow does. Poses are
  /// checked by the app.
  xr::DeviceState devices() const;
};

/// Frames of one step at most.
inline constexpr std::size_t kMaximumFrames = 10'000;
/// Latest game time, some 31 years.
inline constexpr std::int64_t kLatest_ns = 1'000'000'000'000'000'000;

struct TimedPoses {
  std::int64_t time_ns = 0;
  TrackedPoses poses;
};

/// Throws InvalidArgument unless `time_ns` is from 0 to kLatest_ns, what a saved state can hold.
void checkGameTime(std::int64_t time_ns);

/// Input of runtime::LockstepApp::step. Throws as checkGameTime and TrackedPoses::devices do.
std::vector<runtime::FrameInput> frameInputs(std::span<const TimedPoses> frames);

/// A picture of the last frame that a client asks for.
struct PictureRequest {
  std::uint32_t app = 0;
  std::string view = "headset";
  render::ImageSize size{120, 80};
  /// Pose and vertical angle of view in degrees, instead of the view.
  std::optional<std::array<double, xr::kPoseRowNumbers + 1>> observer = std::nullopt;
};

/// Height x width x 4 bytes, and an observer's depths, height x width float32. Throws as
/// runtime::viewFromName, LockstepApp::renderView and renderFrom do, and InvalidArgument for a
/// picture above 64 MiB.
std::vector<std::uint8_t> drawPicture(runtime::LockstepApp& app, const PictureRequest& request);

}  // namespace sim2vr::server

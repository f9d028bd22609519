// What both protocols share: the one error of their decoders, and tracked poses.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/runtime/app.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::server {

/// A received message that is not what its protocol says: the only error that decoders throw. The
/// text names the field, what was got and what was expected.
class MalformedMessage : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The body of a received message, without identity and delimiter.
using Frames = std::span<const std::string_view>;
/// The body of a reply.
using Reply = std::vector<std::string>;

/// Position x y z (m) and rotation x y z w in the app's frame.
using PoseNumbers = std::array<double, 7>;

/// Poses of one frame; the numbers of a device that is not tracked mean nothing.
struct TrackedPoses {
  PoseNumbers head{};
  PoseNumbers left{};
  PoseNumbers right{};
  bool head_tracked = false;
  bool left_tracked = false;
  bool right_tracked = false;

  /// Throws InvalidArgument when the head is not tracked. Poses are checked by runtime::App.
  xr::DeviceState devices() const;
};

/// Frames of one step at most.
inline constexpr std::size_t kMaximumFrames = 10'000;

struct TimedPoses {
  std::int64_t time_ns = 0;
  TrackedPoses poses;
};

/// Input of runtime::App::step.
std::vector<runtime::FrameInput> frameInputs(std::span<const TimedPoses> frames);

/// A picture of the last frame that a client asks for.
struct PictureRequest {
  std::uint32_t app = 0;
  std::string view = "headset";
  render::ImageSize size{120, 80};
};

/// Height x width x 4 bytes. Throws as runtime::viewFromName and App::renderView do, and
/// InvalidArgument for a picture above 64 MiB.
std::vector<std::uint8_t> drawPicture(runtime::App& app, const PictureRequest& request);

/// `text` with bytes that are not UTF-8 replaced.
std::string validUtf8(std::string_view text);

}  // namespace sim2vr::server

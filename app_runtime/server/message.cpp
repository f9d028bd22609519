// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/server/message.hpp"

#include "sim2vr/core/errors.hpp"

namespace sim2vr::server {
namespace {

constexpr std::size_t kMaximumPictureBytes = std::size_t{64} << 20;

}  // namespace

xr::DeviceState TrackedPoses::devices() const {
  if (!head_tracked) throw InvalidArgument("head", "not tracked", "a tracked headset");
  const auto inputs = [](xr::Hand hand, bool tracked, const InputNumbers& row) {
    return xr::inputsFromRow(hand, tracked ? row.data() : nullptr);
  };
  return xr::devicesFromRows(head.data(), left_tracked ? left.data() : nullptr,
                             right_tracked ? right.data() : nullptr,
                             {inputs(xr::Hand::left, left_tracked, left_inputs),
                              inputs(xr::Hand::right, right_tracked, right_inputs)});
}

void checkGameTime(std::int64_t time_ns) {
  if (time_ns >= 0 && time_ns <= kLatest_ns) return;
  throw InvalidArgument("time_ns", std::to_string(time_ns), "0 to " + std::to_string(kLatest_ns));
}

std::vector<runtime::FrameInput> frameInputs(std::span<const TimedPoses> frames) {
  std::vector<runtime::FrameInput> inputs;
  inputs.reserve(frames.size());
  for (const TimedPoses& frame : frames) {
    checkGameTime(frame.time_ns);
    inputs.push_back({frame.time_ns, frame.poses.devices()});
  }
  return inputs;
}

std::vector<std::uint8_t> drawPicture(runtime::LockstepApp& app, const PictureRequest& request) {
  const runtime::View view = runtime::viewFromName(request.view);
  render::checkImageSize(request.size);
  if (4 * request.size.pixels() > kMaximumPictureBytes) {
    throw InvalidArgument(
        "image size",
        std::to_string(request.size.width) + " x " + std::to_string(request.size.height),
        "a picture of 64 MiB at most");
  }
  std::vector<std::uint8_t> pixels(4 * request.size.pixels());
  app.renderView(view, request.size, pixels);
  return pixels;
}

}  // namespace sim2vr::server

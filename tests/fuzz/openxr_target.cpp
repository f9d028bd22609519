// SPDX-License-Identifier: Apache-2.0
// What a harness sends to the OpenXR runtime, through a real socket.
#include <sys/socket.h>
#include <unistd.h>

#include <array>

#include "harness.hpp"
#include "targets.hpp"

namespace sim2vr::fuzz {
namespace {

using openxr::Message;
using openxr::MessageKind;

/// A socket takes more than this without a reader.
constexpr std::size_t kMaximumInput = 100'000;

void check(const openxr::Config& config) {
  require(config.width >= 1 && config.width <= 4096 && config.height >= 1 && config.height <= 4096,
          "the size of a configuration");
  require(config.eyes == 1 || config.eyes == 2, "the eyes of a configuration");
  const XrFovf fov = config.fov();
  require(fov.angleUp > 0.0F && fov.angleRight > 0.0F && fov.angleRight < 1.6F, "a field of view");
  require(config.period_ns() > 0 && config.timeout_s > 0.0, "times of a configuration");
}

void check(const openxr::Step& step) {
  require(!step.frames.empty() && step.frames.size() <= openxr::kMaximumFrames, "a step's frames");
  XrTime latest = 0;
  for (const xr::Frame& frame : step.frames) {
    require(frame.time > latest, "times of frames");
    latest = frame.time;
    for (const xr::ControllerState& hand : frame.devices.hands) {
      require(hand.trigger >= 0.0F && hand.trigger <= 1.0F, "a trigger");
    }
  }
}

void decode(const Message& message) {
  switch (message.kind) {
    case MessageKind::config:
      return check(openxr::decodeConfig(message.body));
    case MessageKind::step:
      return check(openxr::decodeStep(message.body));
    case MessageKind::error:
      openxr::decodeError(message.body);
      return;
    default:
      return;
  }
}

}  // namespace

void openxrMessages(std::string_view input) {
  std::array<int, 2> ends{};
  require(::socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()) == 0, "a socket");
  input = input.substr(0, kMaximumInput);
  require(::send(ends[1], input.data(), input.size(), MSG_DONTWAIT) ==
              static_cast<ssize_t>(input.size()),
          "room for the input");
  ::close(ends[1]);
  openxr::Channel channel(ends[0]);
  try {
    for (;;) {
      const Message message = channel.receive();
      try {
        decode(message);
      } catch (const wire::MalformedMessage&) {
        // Refused; the next one is read.
      }
    }
  } catch (const wire::MalformedMessage&) {
  } catch (const openxr::ChannelClosed&) {
  }
  ::close(ends[0]);
}

}  // namespace sim2vr::fuzz

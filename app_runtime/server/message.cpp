// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/server/message.hpp"

#include <cmath>

#include "sim2vr/core/clock.hpp"

namespace sim2vr::server {
namespace {

constexpr std::string_view kDigits =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
constexpr std::uint8_t kNoDigit = 64;

constexpr std::array<std::uint8_t, 256> digitValues() {
  std::array<std::uint8_t, 256> values{};
  values.fill(kNoDigit);
  for (std::size_t i = 0; i < kDigits.size(); ++i) {
    values[static_cast<unsigned char>(kDigits[i])] = static_cast<std::uint8_t>(i);
  }
  return values;
}

constexpr std::array<std::uint8_t, 256> kValues = digitValues();

std::uint32_t digit(char c) {
  const std::uint8_t value = kValues[static_cast<unsigned char>(c)];
  if (value == kNoDigit) throw MalformedMessage("base64: got a character outside its alphabet");
  return value;
}

std::uint32_t byteAt(std::string_view bytes, std::size_t i) {
  return i < bytes.size() ? static_cast<unsigned char>(bytes[i]) : 0U;
}

constexpr double kLatest_s = 1e9;
constexpr double kGridTolerance = 1e-6;
constexpr double kGridTolerancePerState = 1e-8;

constexpr std::size_t kMaximumPictureBytes = std::size_t{64} << 20;

}  // namespace

std::string encodeBase64(std::string_view bytes) {
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::uint32_t bits =
        byteAt(bytes, i) << 16 | byteAt(bytes, i + 1) << 8 | byteAt(bytes, i + 2);
    text += kDigits[bits >> 18 & 63];
    text += kDigits[bits >> 12 & 63];
    text += i + 1 < bytes.size() ? kDigits[bits >> 6 & 63] : '=';
    text += i + 2 < bytes.size() ? kDigits[bits & 63] : '=';
  }
  return text;
}

std::string decodeBase64(std::string_view text) {
  if (text.size() % 4 != 0) {
    throw MalformedMessage("base64: got " + std::to_string(text.size()) +
                           " characters, expected a multiple of 4");
  }
  const std::size_t padding = text.ends_with("==") ? 2 : text.ends_with('=') ? 1 : 0;
  std::string bytes;
  bytes.reserve(text.size() / 4 * 3);
  for (std::size_t i = 0; i < text.size(); i += 4) {
    const std::size_t digits = i + 4 == text.size() ? 4 - padding : 4;
    std::uint32_t bits = 0;
    for (std::size_t d = 0; d < 4; ++d) bits = bits << 6 | (d < digits ? digit(text[i + d]) : 0U);
    bytes += static_cast<char>(bits >> 16 & 255);
    if (digits > 2) bytes += static_cast<char>(bits >> 8 & 255);
    if (digits > 3) bytes += static_cast<char>(bits & 255);
    const std::uint32_t unused = digits == 2 ? 0xFFFFU : digits == 3 ? 0xFFU : 0U;
    if ((bits & unused) != 0) throw MalformedMessage("base64: got bits after the last byte");
  }
  return bytes;
}

std::int64_t frameTimeNs(double time_s, int sample_frequency_hz) {
  if (!(time_s >= 0.0 && time_s <= kLatest_s)) {
    throw InvalidArgument("time", std::to_string(time_s) + " s", "0 to 1e9 s");
  }
  const double states = time_s * sample_frequency_hz;
  const double n = std::round(states);
  if (std::abs(states - n) <= kGridTolerance + kGridTolerancePerState * n) {
    return lockstepFrameTimeNs(static_cast<std::int64_t>(n), sample_frequency_hz);
  }
  return std::llround(time_s * 1e9);
}

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
  if (!request.observer) {
    app.renderView(view, request.size, pixels);
    return pixels;
  }
  std::vector<float> depth_m(request.size.pixels());
  app.renderFrom(xr::poseFromRow(request.observer->data()), request.observer->back(), request.size,
                 pixels, depth_m);
  const auto* depths = reinterpret_cast<const std::uint8_t*>(depth_m.data());
  pixels.insert(pixels.end(), depths, depths + depth_m.size() * sizeof(float));
  return pixels;
}

}  // namespace sim2vr::server

// SPDX-License-Identifier: Apache-2.0
#include "harness.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <nlohmann/json.hpp>

#include "objects.hpp"
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

struct timespec timespecOf(std::int64_t duration_ns) {
  return {duration_ns / kSecond_ns, duration_ns % kSecond_ns};
}

constexpr const char* kVariable = "SIM2VR_OPENXR_SOCKET";

[[noreturn]] void unavailable(const std::string& cause) {
  throw Failure(XR_ERROR_RUNTIME_UNAVAILABLE, cause);
}

int socketOf(const char* text) {
  int socket = -1;
  const char* end = text + std::strlen(text);
  const auto [stop, problem] = std::from_chars(text, end, socket);
  int type = 0;
  socklen_t bytes = sizeof type;
  if (problem != std::errc() || stop != end || socket < 0 ||
      ::getsockopt(socket, SOL_SOCKET, SO_TYPE, &type, &bytes) != 0 || type != SOCK_STREAM) {
    unavailable(
        fmt::format("{}: got '{}', expected the number of an open stream socket", kVariable, text));
  }
  return socket;
}

}  // namespace

void Channel::send(MessageKind kind, std::string_view body, int file) {
  if (body.size() + 1 > kMaximumMessageBytes) {
    throw wire::MalformedMessage(
        fmt::format("message to the harness: got {} bytes, expected up to {}", body.size() + 1,
                    kMaximumMessageBytes));
  }
  std::string bytes;
  wire::append(bytes, static_cast<std::uint32_t>(body.size() + 1));
  wire::append(bytes, static_cast<std::uint8_t>(kind));
  bytes += body;
  const std::lock_guard lock(sending_);
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof file)> control{};
  for (std::size_t sent = 0; sent < bytes.size();) {
    iovec rest{bytes.data() + sent, bytes.size() - sent};
    msghdr message{};
    message.msg_iov = &rest;
    message.msg_iovlen = 1;
    if (file >= 0 && sent == 0) {
      message.msg_control = control.data();
      message.msg_controllen = control.size();
      cmsghdr* rights = CMSG_FIRSTHDR(&message);
      rights->cmsg_level = SOL_SOCKET;
      rights->cmsg_type = SCM_RIGHTS;
      rights->cmsg_len = CMSG_LEN(sizeof file);
      std::memcpy(CMSG_DATA(rights), &file, sizeof file);
    }
    const ssize_t n = ::sendmsg(socket_, &message, MSG_NOSIGNAL);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw ChannelClosed(fmt::format("the harness is gone ({})", std::strerror(errno)));
    sent += static_cast<std::size_t>(n);
  }
}

void Channel::read(char* to, std::size_t bytes) {
  while (bytes > 0) {
    const ssize_t n = ::recv(socket_, to, bytes, 0);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno == EAGAIN) {
      throw ChannelClosed(
          fmt::format("the harness gave no answer within {:g} s, expected one to every hello and "
                      "session; see where it hangs, and start the program again",
                      limit_s_));
    }
    if (n < 0) throw ChannelClosed(fmt::format("the harness is gone ({})", std::strerror(errno)));
    if (n == 0) throw ChannelClosed("the harness is gone (it closed the socket)");
    to += n;
    bytes -= static_cast<std::size_t>(n);
  }
}

Message Channel::receive() {
  std::array<char, 5> head{};
  read(head.data(), head.size());
  wire::Reader reader(std::string_view(head.data(), head.size()));
  const auto length = reader.take<std::uint32_t>();
  const auto kind = reader.take<std::uint8_t>();
  if (length < 1 || length > kMaximumMessageBytes) {
    throw wire::MalformedMessage(fmt::format("message.length: got {} bytes, expected 1 to {}",
                                             length, kMaximumMessageBytes));
  }
  if (kind < 1 || kind > static_cast<std::uint8_t>(MessageKind::error)) {
    throw wire::MalformedMessage(fmt::format("message.kind: got {}, expected 1 to 9", kind));
  }
  Message message{static_cast<MessageKind>(kind), std::string(length - 1, '\0')};
  read(message.body.data(), message.body.size());
  return message;
}

void Channel::limit(double seconds) {
  limit_s_ = seconds;
  // The kernel's own time-out: poll() would wait for virtual time.
  const auto us = static_cast<std::int64_t>(seconds * 1e6);
  const timeval time{us / 1'000'000, us % 1'000'000};
  ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &time, sizeof time);
}

void Channel::shutdown() { ::shutdown(socket_, SHUT_RDWR); }

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

std::int64_t realNow_ns() {
  struct timespec now{};
  ::syscall(SYS_clock_gettime, CLOCK_MONOTONIC, &now);
  return now.tv_sec * kSecond_ns + now.tv_nsec;
}

void realSleep(std::int64_t duration_ns) {
  if (duration_ns <= 0) return;
  const struct timespec duration = timespecOf(duration_ns);
  ::syscall(SYS_nanosleep, &duration, nullptr);
}

Bell::Bell() : event_(::eventfd(0, EFD_CLOEXEC)) {}

Bell::~Bell() { ::close(event_); }

void Bell::ring() { ::eventfd_write(event_, 1); }

void Bell::wait(std::int64_t duration_ns) const {
  struct pollfd waited{event_, POLLIN, 0};
  const struct timespec duration = timespecOf(duration_ns);
  ::syscall(SYS_ppoll, &waited, 1, &duration, nullptr, 0);
}

std::shared_ptr<Harness> Harness::connect(const Hello& hello) {
  const char* text = std::getenv(kVariable);
  if (text == nullptr) return nullptr;
  const int socket = socketOf(text);
  // Programs that this one starts do not keep the socket open.
  ::fcntl(socket, F_SETFD, FD_CLOEXEC);
  watchForks(socket);
  try {
    return std::make_shared<Harness>(socket, hello);
  } catch (const ChannelClosed& error) {
    unavailable(error.what());
  } catch (const wire::MalformedMessage& error) {
    unavailable(error.what());
  }
}

Harness::Harness(int socket, const Hello& hello, double greeting_s)
    : channel_(socket), greeting_s_(greeting_s) {
  channel_.send(MessageKind::hello, encodeHello(hello));
  channel_.limit(greeting_s_);
  const Message message = channel_.receive();
  channel_.limit(0.0);
  if (message.kind == MessageKind::error) unavailable(decodeError(message.body));
  if (message.kind != MessageKind::config) {
    unavailable(
        fmt::format("message.kind: got {}, expected config (2)", static_cast<int>(message.kind)));
  }
  config_ = decodeConfig(message.body);
  watchman_ = std::thread([this] { watch(); });
}

Harness::~Harness() { stopWatching(); }

void Harness::stopWatching() {
  closing_ = true;
  bell_.ring();
  if (watchman_.joinable()) watchman_.join();
}

void Harness::openSession(std::string_view graphics, bool depth_layers) {
  SessionFacts facts;
  facts.graphics = graphics;
  facts.depth_layers = depth_layers;
  images_.reset();
  if (config_.images) {
    images_ = wire::SharedImages::create(config_.eyes, config_.eyeBytes());
    if (!images_) throw Failure(XR_ERROR_OUT_OF_MEMORY, "no shared memory for images");
    facts.image_bytes = config_.eyes * config_.eyeBytes();
  }
  events_.clear();
  Message message;
  try {
    channel_.send(MessageKind::session, encodeSession(facts), images_ ? images_->file() : -1);
    channel_.limit(greeting_s_);
    message = channel_.receive();
    channel_.limit(0.0);
  } catch (const std::runtime_error& error) {
    lost_ = true;
    throw Failure(XR_ERROR_RUNTIME_FAILURE, error.what());
  }
  if (message.kind == MessageKind::accepted) return;
  throw Failure(XR_ERROR_RUNTIME_FAILURE,
                message.kind == MessageKind::error
                    ? decodeError(message.body)
                    : fmt::format("message.kind: got {}, expected accepted (4) or error (9)",
                                  static_cast<int>(message.kind)));
}

std::optional<Step> Harness::nextStep() {
  const Message message = channel_.receive();
  if (message.kind == MessageKind::quit) return std::nullopt;
  if (message.kind == MessageKind::error) throw ChannelClosed(decodeError(message.body));
  if (message.kind != MessageKind::step) {
    throw wire::MalformedMessage(fmt::format("message.kind: got {}, expected step (5) or quit (7)",
                                             static_cast<int>(message.kind)));
  }
  Step step = decodeStep(message.body);
  if (step.frames.front().time <= latest_) {
    throw wire::MalformedMessage(
        fmt::format("step.frames[0].time: got {} ns, expected above {}, the previous frame's",
                    step.frames.front().time, latest_));
  }
  latest_ = step.frames.back().time;
  return step;
}

void Harness::answer(Answer answer, const Picture& picture) {
  answer.has_image = picture.has_image && images_ != nullptr;
  answer.has_depth = answer.has_image && picture.has_depth;
  if (answer.has_image) {
    const std::span<const std::uint8_t> all(picture.rgba);
    for (std::uint32_t eye = 0; eye < config_.eyes; ++eye) {
      images_->write(eye, all.subspan(eye * config_.eyeBytes(), config_.eyeBytes()));
    }
  }
  answer.events = std::exchange(events_, {});
  channel_.send(MessageKind::answer, encodeAnswer(answer));
}

void Harness::note(Event event) {
  constexpr std::size_t kMaximumEvents = 2000;
  if (events_.size() < kMaximumEvents) events_.push_back(std::move(event));
}

void Harness::ended(std::string_view reason, std::string_view call) {
  if (told_.exchange(true)) return;
  try {
    channel_.send(MessageKind::ended, encodeEnded(reason, call));
  } catch (const std::exception&) {
    lost_ = true;
  }
}

void Harness::expect(const char* call, const char* cause) {
  const std::lock_guard lock(watching_);
  if (lost_) return;
  told_ = false;
  call_ = call;
  cause_ = cause;
  deadline_ns_ = realNow_ns() + static_cast<std::int64_t>(config_.timeout_s * 1e9);
}

void Harness::relax() {
  const std::lock_guard lock(watching_);
  deadline_ns_.reset();
}

void Harness::watch() {
  // Looking up every tenth of the timeout, the watch needs no wake-up at each call.
  const auto pause_ns = static_cast<std::int64_t>(std::min(0.25, config_.timeout_s / 10.0) * 1e9);
  while (!closing_) {
    bell_.wait(pause_ns);
    const char* cause = nullptr;
    const char* call = nullptr;
    {
      const std::lock_guard lock(watching_);
      if (closing_ || !deadline_ns_ || realNow_ns() < *deadline_ns_) continue;
      deadline_ns_.reset();
      cause = cause_;
      call = call_;
    }
    try {
      const std::string reason = fmt::format("{} within {:g} s", cause, config_.timeout_s);
      report(fmt::format("sim2vr OpenXR: {}: {}", call, reason));
      ended(reason, call);
    } catch (const std::bad_alloc&) {  // the harness finds the socket closed
      std::fprintf(stderr, "sim2vr OpenXR: %s: %s in time\n", call, cause);
    }
    lost_ = true;
    const Lock lock(world().mutex);
    world().changed.notify_all();
  }
}

}  // namespace sim2vr::openxr

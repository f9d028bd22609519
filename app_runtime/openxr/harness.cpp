// SPDX-License-Identifier: Apache-2.0
#include "harness.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/socket.h>

#include <charconv>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "failure.hpp"
#include "world.hpp"

namespace sim2vr::openxr {
namespace {

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

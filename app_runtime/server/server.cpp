#include "sim2vr/server/server.hpp"

#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <optional>
#include <utility>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/core/text.hpp"
#include "sim2vr/server/session.hpp"
#include "transport.hpp"

namespace sim2vr::server {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kHighestPort = 65535;
/// More than a client can have on its way (see Transport), so that nobody keeps a dead session up.
constexpr int kMessagesOfOneGone = 64;
/// Lines of the log that strangers can fill.
constexpr int kLoggedRefusals = 10;

bool isEndpoint(const std::string& address) { return address.find("://") != std::string::npos; }

}  // namespace

std::string ServerSettings::endpoint() const {
  if (isEndpoint(address)) return address;
  if (port < 0 || port > kHighestPort) {
    throw InvalidArgument("port", std::to_string(port), "0 to 65535");
  }
  const bool v6 = address.find(':') != std::string::npos;
  return "tcp://" + (v6 ? "[" + address + "]" : address) + ":" +
         (port == 0 ? "*" : std::to_string(port));
}

bool ServerSettings::isLocal() const {
  const std::string bound = endpoint();
  for (const char* local : {"ipc://", "tcp://127.", "tcp://[::1]:", "tcp://localhost:"}) {
    if (bound.starts_with(local)) return true;
  }
  return false;
}

StopRequest::StopRequest() : descriptor_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (descriptor_ < 0) throw EngineError(std::string("eventfd: ") + std::strerror(errno));
}

StopRequest::~StopRequest() { ::close(descriptor_); }

void StopRequest::raise() {
  raised_.store(true);
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(descriptor_, &one, sizeof(one));
}

class Server::Implementation {
 public:
  explicit Implementation(ServerSettings settings)
      : settings_(std::move(settings)), transport_(settings_.endpoint()), host_(hostSettings()) {
    host_.renderer(settings_.host.renderer);  // now, not in the first client's time
  }

  const std::string& endpoint() const { return transport_.endpoint(); }

  Ending run(const StopRequest& stop) {
    last_message_ = Clock::now();
    host_.stopOn(&stop.raised());
    while (true) {
      Transport::Events events = transport_.wait(stop.descriptor(), timeLeft());
      if (events.stop) return end(Ending::stopped);
      // The owner may have sent quit, and more, before its connection went.
      if (ownerGone(events.closed)) messages_left_ = kMessagesOfOneGone;
      if (events.message) take(*events.message);
      const std::optional<Ending> ending = endingNow(events.message.has_value());
      if (!ending) continue;
      end(*ending);
      if (!settings_.keep) return *ending;
    }
  }

 private:
  HostSettings hostSettings() const {
    HostSettings host = settings_.host;
    host.local = settings_.isLocal();
    return host;
  }

  /// Until the time-out; none while it does not count.
  std::optional<std::chrono::milliseconds> timeLeft() const {
    if (messages_left_) return std::chrono::milliseconds(0);
    if (session_ == nullptr && settings_.keep) return std::nullopt;
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(
        last_message_ + settings_.timeout - Clock::now());
    return std::max(left, std::chrono::milliseconds(0));
  }

  /// Whether the session, or the wait for a first client, ends here.
  std::optional<Ending> endingNow(bool message) {
    if (session_ != nullptr && session_->over()) return Ending::quit;
    if (messages_left_) {
      if (message && --*messages_left_ > 0) return std::nullopt;
      return Ending::client_vanished;
    }
    if (timeLeft() != std::chrono::milliseconds(0)) return std::nullopt;
    return Ending::timed_out;
  }

  bool ownerGone(const std::vector<int>& closed) const {
    if (session_ == nullptr || owner_connection_ < 0) return false;
    return std::find(closed.begin(), closed.end(), owner_connection_) != closed.end();
  }

  void take(const Envelope& message) {
    const std::vector<std::string_view> body = message.body();
    if (session_ == nullptr) {
      open(message, body);
    } else if (message.client == owner_) {
      transport_.send(message, session_->answer(body));
      last_message_ = Clock::now();
    } else {
      refuse(message, body);
    }
  }

  void refuse(const Envelope& message, Frames body) {
    if (++refusals_ <= kLoggedRefusals) logger().warn("a second client was refused");
    transport_.send(message,
                    errorReply(body, {protocol2::Status::busy,
                                      "busy: another client owns the session; start another "
                                      "sim2vr-app for this one"}));
  }

  void open(const Envelope& message, Frames body) {
    Opening opening = openSession(host_, body);
    session_ = std::move(opening.session);
    if (session_ == nullptr) {
      if (++refusals_ <= kLoggedRefusals) {
        logger().warn("a client was refused: {}", printable(opening.refusal));
      }
    } else {
      owner_ = message.client;
      owner_connection_ = message.connection;
      last_message_ = Clock::now();
      refusals_ = 0;
    }
    transport_.send(message, std::move(opening.reply));
  }

  Ending end(Ending ending) {
    switch (ending) {
      case Ending::quit:
        logger().info("session over: the client quit");
        break;
      case Ending::stopped:
        logger().info("asked to end");
        break;
      case Ending::timed_out:
        logger().error("timed out: no message received for {} s",
                       std::chrono::duration<double>(settings_.timeout).count());
        break;
      case Ending::client_vanished:
        logger().error("session over: the client's connection went away without quit");
        break;
    }
    if (refusals_ > kLoggedRefusals) {
      logger().warn("{} messages of other clients were refused in all", refusals_);
    }
    if (session_ != nullptr) host_.endSession();
    session_ = nullptr;
    messages_left_.reset();
    refusals_ = 0;
    return ending;
  }

  ServerSettings settings_;
  Transport transport_;
  AppHost host_;
  std::unique_ptr<Session> session_;
  std::string owner_;
  int owner_connection_ = -1;
  std::int64_t refusals_ = 0;
  /// Messages to look at for one of the owner, whose connection went away; none while it is there.
  std::optional<int> messages_left_;
  Clock::time_point last_message_;
};

Server::Server(ServerSettings settings)
    : implementation_(std::make_unique<Implementation>(std::move(settings))) {}

Server::~Server() = default;

const std::string& Server::endpoint() const { return implementation_->endpoint(); }

Ending Server::run(const StopRequest& stop) { return implementation_->run(stop); }

}  // namespace sim2vr::server

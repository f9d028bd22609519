// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/server/server.hpp"

#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>
#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>
#include <zmq.hpp>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/core/text.hpp"
#include "sim2vr/server/message.hpp"
#include "sim2vr/server/session.hpp"

namespace sim2vr::server {
namespace {

struct ReceivedMessage {
  /// The connection's name; a new one for each connection.
  std::string client;
  /// The socket it came through, -1 when unknown.
  int connection = -1;
  /// False when the sender left out the empty frame before the body.
  bool delimited = true;
  std::vector<zmq::message_t> frames;

  std::vector<std::string_view> body() const;
};

/// The server's socket: ROUTER, so that a second client can be refused with a reply, with a monitor
/// that notices when a client's connection goes away. The only user of ZeroMQ.
///
/// Where the process has no descriptor left for a connection that waits, ZeroMQ tries to accept it
/// again and again, on all of a core. A spare one is kept for that: it lets such connections in,
/// one after the other, to be closed at once.
class Transport {
 public:
  /// Throws InvalidArgument when the endpoint cannot be bound, or too few files may be opened.
  explicit Transport(const std::string& endpoint);
  ~Transport();

  const std::string& endpoint() const { return endpoint_; }

  /// What a wait has brought.
  struct Events {
    bool stop = false;
    /// Connections that went away, before the message came.
    std::vector<int> closed;
    std::optional<ReceivedMessage> message;
  };
  /// Waits for a message, a closed connection, or `stop_descriptor`; at most until `timeout`
  /// (none: for ever).
  Events wait(int stop_descriptor, std::optional<std::chrono::milliseconds> timeout);

  /// A client that is gone gets nothing.
  void send(const ReceivedMessage& to, Reply reply);

 private:
  void readMonitor(std::vector<int>& closed);
  void giveSpare();
  std::optional<ReceivedMessage> receive();

  zmq::context_t context_;
  zmq::socket_t router_;
  zmq::socket_t monitor_;
  std::string endpoint_;
  /// An open descriptor for nothing; -1 while it is given away.
  int spare_ = -1;
  bool warned_of_descriptors_ = false;
};

constexpr const char* kMonitorEndpoint = "inproc://connections";
constexpr int kWatched = ZMQ_EVENT_ACCEPTED | ZMQ_EVENT_ACCEPT_FAILED | ZMQ_EVENT_DISCONNECTED |
                         ZMQ_EVENT_MONITOR_STOPPED;
constexpr std::int64_t kMaximumFrameBytes = std::int64_t{64} << 20;
/// More frames than any message has: the rest is dropped, the decoder refuses the message.
constexpr std::size_t kMaximumParts = 16;
/// Messages in lockstep come one at a time; what a client sends beyond this waits on its side.
constexpr int kQueuedMessages = 16;
/// What a socket, its monitor and the first client need.
constexpr std::size_t kDescriptors = 16;
/// The last reply gets this long to leave.
constexpr int kLinger_ms = 1000;

zmq::message_t toMessage(std::string&& text) {
  // Hands the string over as it is: pictures are not copied again.
  auto owned = std::make_unique<std::string>(std::move(text));
  std::string* kept = owned.get();
  zmq::message_t message(
      kept->data(), kept->size(), [](void*, void* hint) { delete static_cast<std::string*>(hint); },
      kept);
  owned.release();
  return message;
}

/// Whether accept failed for lack of descriptors or memory, which the next try lacks, too.
bool isShortage(int error) {
  return error == EMFILE || error == ENFILE || error == ENOBUFS || error == ENOMEM;
}

int newDescriptor() { return ::eventfd(0, EFD_CLOEXEC); }

/// ZeroMQ ends the whole process where it finds no descriptor for its own needs.
zmq::context_t newContext() {
  std::vector<int> taken;
  while (taken.size() < kDescriptors && (taken.empty() || taken.back() >= 0)) {
    taken.push_back(newDescriptor());
  }
  const bool enough = taken.back() >= 0;
  if (!enough) taken.pop_back();
  for (const int descriptor : taken) ::close(descriptor);
  if (enough) return {};
  throw InvalidArgument("open files", std::to_string(taken.size()) + " more that may be opened",
                        std::to_string(kDescriptors) + " or more; 'ulimit -n' sets their number");
}

/// What the socket's monitor says.
struct Event {
  std::uint16_t kind = 0;
  /// The connection's socket, or an errno.
  std::int32_t value = -1;
};

constexpr auto kWaits = zmq::recv_flags::none;

bool nextEvent(zmq::socket_t& monitor, Event& event, zmq::recv_flags how) {
  zmq::message_t frame;
  if (!monitor.recv(frame, how)) return false;
  event = {};
  if (frame.size() >= sizeof(event.kind) + sizeof(event.value)) {
    std::memcpy(&event.kind, frame.data<char>(), sizeof(event.kind));
    std::memcpy(&event.value, frame.data<char>() + sizeof(event.kind), sizeof(event.value));
  }
  // A frame with the address follows.
  while (frame.more() && monitor.recv(frame, how)) {
  }
  return true;
}

int connectionOf(zmq::message_t& message) { return zmq_msg_get(message.handle(), ZMQ_SRCFD); }

std::vector<std::string_view> ReceivedMessage::body() const {
  std::vector<std::string_view> views;
  for (const zmq::message_t& frame : frames) views.push_back(frame.to_string_view());
  return views;
}

Transport::Transport(const std::string& endpoint)
    : context_(newContext()),
      router_(context_, zmq::socket_type::router),
      monitor_(context_, zmq::socket_type::pair) {
  router_.set(zmq::sockopt::maxmsgsize, kMaximumFrameBytes);
  router_.set(zmq::sockopt::rcvhwm, kQueuedMessages);
  router_.set(zmq::sockopt::linger, kLinger_ms);
  router_.set(zmq::sockopt::ipv6, endpoint.find('[') != std::string::npos);
  if (zmq_socket_monitor(router_.handle(), kMonitorEndpoint, kWatched) != 0) {
    throw EngineError(std::string("cannot watch the socket: ") + zmq_strerror(zmq_errno()));
  }
  monitor_.set(zmq::sockopt::linger, 0);
  monitor_.connect(kMonitorEndpoint);
  try {
    router_.bind(endpoint);
  } catch (const zmq::error_t& error) {
    const bool busy = error.num() == EADDRINUSE;
    throw InvalidArgument(busy ? "port" : "bind", "'" + endpoint + "' (" + error.what() + ")",
                          busy ? "a free port; 0 picks one" : "an address of this machine");
  }
  endpoint_ = router_.get(zmq::sockopt::last_endpoint);
  spare_ = newDescriptor();
}

Transport::~Transport() {
  // The socket's thread may be waiting for its events to be read, and cannot stop
  // before.
  std::thread reader([this] {
    Event event;
    while (event.kind != ZMQ_EVENT_MONITOR_STOPPED) {
      try {
        nextEvent(monitor_, event, kWaits);
      } catch (const zmq::error_t& error) {
        if (error.num() != EINTR) return;
      }
    }
  });
  zmq_socket_monitor(router_.handle(), nullptr, 0);
  reader.join();
  if (spare_ >= 0) ::close(spare_);
}

Transport::Events Transport::wait(int stop_descriptor,
                                  std::optional<std::chrono::milliseconds> timeout) {
  std::array<zmq::pollitem_t, 3> items{{{router_.handle(), 0, ZMQ_POLLIN, 0},
                                        {monitor_.handle(), 0, ZMQ_POLLIN, 0},
                                        {nullptr, stop_descriptor, ZMQ_POLLIN, 0}}};
  try {
    zmq::poll(items.data(), items.size(), timeout.value_or(std::chrono::milliseconds(-1)));
  } catch (const zmq::error_t& error) {
    if (error.num() != EINTR) throw;
  }
  Events events;
  events.stop = (items[2].revents & ZMQ_POLLIN) != 0;
  // Connections first: the number of one that is gone may be in use again by the message's.
  readMonitor(events.closed);
  events.message = receive();
  return events;
}

void Transport::readMonitor(std::vector<int>& closed) {
  Event event;
  bool short_of_descriptors = false;
  while (nextEvent(monitor_, event, zmq::recv_flags::dontwait)) {
    if (event.kind == ZMQ_EVENT_DISCONNECTED) closed.push_back(event.value);
    if (event.kind == ZMQ_EVENT_ACCEPT_FAILED && isShortage(event.value)) {
      giveSpare();
      short_of_descriptors = true;
    }
    // The client that came in thanks to the spare one makes room for it.
    if (event.kind == ZMQ_EVENT_ACCEPTED && spare_ < 0) ::shutdown(event.value, SHUT_RDWR);
  }
  // Not at once: where there is one processor only, the socket's thread has not run yet, and
  // a client that it let in with the spare one would wait for ever.
  if (spare_ < 0 && !short_of_descriptors) spare_ = newDescriptor();
}

void Transport::giveSpare() {
  if (spare_ >= 0) ::close(spare_);
  spare_ = -1;
  if (warned_of_descriptors_) return;
  warned_of_descriptors_ = true;
  logger().warn(
      "no descriptor is left for another connection: new ones are closed; 'ulimit -n' allows more");
}

std::optional<ReceivedMessage> Transport::receive() {
  zmq::message_t part;
  if (!router_.recv(part, zmq::recv_flags::dontwait)) return std::nullopt;
  ReceivedMessage message;
  message.client = part.to_string();
  bool more = part.more();
  while (more) {
    zmq::message_t frame;
    if (!router_.recv(frame, zmq::recv_flags::none)) break;
    more = frame.more();
    message.connection = connectionOf(frame);
    if (message.frames.size() < kMaximumParts) message.frames.push_back(std::move(frame));
  }
  message.delimited = !message.frames.empty() && message.frames.front().size() == 0;
  if (message.delimited) message.frames.erase(message.frames.begin());
  return message;
}

void Transport::send(const ReceivedMessage& to, Reply reply) {
  router_.send(zmq::buffer(to.client), zmq::send_flags::sndmore);
  if (to.delimited) router_.send(zmq::message_t(), zmq::send_flags::sndmore);
  for (std::size_t i = 0; i < reply.size(); ++i) {
    const bool last = i + 1 == reply.size();
    router_.send(toMessage(std::move(reply[i])),
                 last ? zmq::send_flags::none : zmq::send_flags::sndmore);
  }
}

using Clock = std::chrono::steady_clock;

constexpr int kHighestPort = 65535;
/// More than a client can have on its way (see Transport), so that no client keeps a dead session
/// up.
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

  void take(const ReceivedMessage& message) {
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

  void refuse(const ReceivedMessage& message, Frames body) {
    if (++refusals_ <= kLoggedRefusals) logger().warn("a second client was refused");
    transport_.send(message,
                    errorReply(body, {protocol2::Status::busy,
                                      "busy: another client owns the session; start another "
                                      "sim2vr-app for this one"}));
  }

  void open(const ReceivedMessage& message, Frames body) {
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

#include "transport.hpp"

#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <memory>
#include <thread>
#include <utility>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"

namespace sim2vr::server {
namespace {

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

}  // namespace

std::vector<std::string_view> Envelope::body() const {
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
    throw InvalidArgument(
        busy ? "port" : "bind", "'" + endpoint + "' (" + error.what() + ")",
        busy ? "a port that nobody listens on; 0 picks one" : "an address of this machine");
  }
  endpoint_ = router_.get(zmq::sockopt::last_endpoint);
  spare_ = newDescriptor();
}

Transport::~Transport() {
  // The socket's thread may be waiting for somebody to read what it has to say, and cannot stop
  // saying it before.
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
    // Whoever came in thanks to the spare one makes room for it.
    if (event.kind == ZMQ_EVENT_ACCEPTED && spare_ < 0) ::shutdown(event.value, SHUT_RDWR);
  }
  // Not at once: where there is one processor only, the socket's thread has not run yet, and
  // whoever it would let in with the spare one would wait for ever.
  if (spare_ < 0 && !short_of_descriptors) spare_ = newDescriptor();
}

void Transport::giveSpare() {
  if (spare_ >= 0) ::close(spare_);
  spare_ = -1;
  if (told_of_descriptors_) return;
  told_of_descriptors_ = true;
  logger().warn(
      "no descriptor is left for another connection: new ones are closed; 'ulimit -n' allows more");
}

std::optional<Envelope> Transport::receive() {
  zmq::message_t part;
  if (!router_.recv(part, zmq::recv_flags::dontwait)) return std::nullopt;
  Envelope envelope;
  envelope.client = part.to_string();
  bool more = part.more();
  while (more) {
    zmq::message_t frame;
    if (!router_.recv(frame, zmq::recv_flags::none)) break;
    more = frame.more();
    envelope.connection = connectionOf(frame);
    if (envelope.frames.size() < kMaximumParts) envelope.frames.push_back(std::move(frame));
  }
  envelope.delimited = !envelope.frames.empty() && envelope.frames.front().size() == 0;
  if (envelope.delimited) envelope.frames.erase(envelope.frames.begin());
  return envelope;
}

void Transport::send(const Envelope& to, Reply reply) {
  router_.send(zmq::buffer(to.client), zmq::send_flags::sndmore);
  if (to.delimited) router_.send(zmq::message_t(), zmq::send_flags::sndmore);
  for (std::size_t i = 0; i < reply.size(); ++i) {
    const bool last = i + 1 == reply.size();
    router_.send(toMessage(std::move(reply[i])),
                 last ? zmq::send_flags::none : zmq::send_flags::sndmore);
  }
}

}  // namespace sim2vr::server

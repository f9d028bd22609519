#include "transport.hpp"

#include <array>
#include <cerrno>
#include <cstring>
#include <memory>
#include <utility>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::server {
namespace {

constexpr const char* kMonitorEndpoint = "inproc://connections";
constexpr std::int64_t kMaximumFrameBytes = std::int64_t{64} << 20;
/// More frames than any message has: the rest is dropped, the decoder refuses the message.
constexpr std::size_t kMaximumParts = 16;
/// Messages in lockstep come one at a time; what a client sends beyond this waits on its side.
constexpr int kQueuedMessages = 16;
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

int connectionOf(zmq::message_t& message) { return zmq_msg_get(message.handle(), ZMQ_SRCFD); }

}  // namespace

std::vector<std::string_view> Envelope::body() const {
  std::vector<std::string_view> views;
  for (const zmq::message_t& frame : frames) views.push_back(frame.to_string_view());
  return views;
}

Transport::Transport(const std::string& endpoint)
    : router_(context_, zmq::socket_type::router), monitor_(context_, zmq::socket_type::pair) {
  router_.set(zmq::sockopt::maxmsgsize, kMaximumFrameBytes);
  router_.set(zmq::sockopt::rcvhwm, kQueuedMessages);
  router_.set(zmq::sockopt::linger, kLinger_ms);
  router_.set(zmq::sockopt::ipv6, endpoint.find('[') != std::string::npos);
  if (zmq_socket_monitor(router_.handle(), kMonitorEndpoint, ZMQ_EVENT_DISCONNECTED) != 0) {
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
}

Transport::~Transport() { zmq_socket_monitor(router_.handle(), nullptr, 0); }

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
  closedConnections(events.closed);
  events.message = receive();
  return events;
}

void Transport::closedConnections(std::vector<int>& closed) {
  zmq::message_t event;
  while (monitor_.recv(event, zmq::recv_flags::dontwait)) {
    // uint16 event, int32 value (the socket); then a frame with the address.
    std::int32_t value = -1;
    if (event.size() >= 6) std::memcpy(&value, event.data<char>() + 2, sizeof(value));
    closed.push_back(value);
    while (event.more() && monitor_.recv(event, zmq::recv_flags::dontwait)) {
    }
  }
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

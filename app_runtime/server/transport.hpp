// The server's socket: ROUTER, so that a second client can be told that it is the second, with a
// monitor that notices when a client's connection goes away. The only user of ZeroMQ.
//
// Where the process has no descriptor left for a connection that waits, ZeroMQ tries to accept it
// again and again, on all of a core. A spare one is kept for that: it lets such connections in, one
// after the other, to be closed at once.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <string_view>
#include <vector>
#include <zmq.hpp>

#include "sim2vr/server/message.hpp"

namespace sim2vr::server {

struct Envelope {
  /// The connection's name; a new one for each connection.
  std::string client;
  /// The socket it came through, -1 when unknown.
  int connection = -1;
  /// False when the sender left out the empty frame before the body.
  bool delimited = true;
  std::vector<zmq::message_t> frames;

  std::vector<std::string_view> body() const;
};

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
    std::optional<Envelope> message;
  };
  /// Waits for a message, a closed connection, or `stop_descriptor`; at most until `timeout`
  /// (none: for ever).
  Events wait(int stop_descriptor, std::optional<std::chrono::milliseconds> timeout);

  /// A client that is gone gets nothing.
  void send(const Envelope& to, Reply reply);

 private:
  void readMonitor(std::vector<int>& closed);
  void giveSpare();
  std::optional<Envelope> receive();

  zmq::context_t context_;
  zmq::socket_t router_;
  zmq::socket_t monitor_;
  std::string endpoint_;
  /// An open descriptor for nothing; -1 while it is given away.
  int spare_ = -1;
  bool told_of_descriptors_ = false;
};

}  // namespace sim2vr::server

// A Unix stream socket beside ZeroMQ's, for clients on this machine. ZeroMQ hands every message
// from its own thread to ours and back; here an exchange wakes half as many threads, which is most
// of what it costs.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "sim2vr/server/message.hpp"
#include "sim2vr/server/message_stream.hpp"

namespace sim2vr::server {

class LocalSocket {
 public:
  /// `name`: the path of a file, or after an @ a name without a file (Linux). Throws
  /// InvalidArgument when nobody can listen there.
  explicit LocalSocket(const std::string& name);
  ~LocalSocket();
  LocalSocket(const LocalSocket&) = delete;
  LocalSocket& operator=(const LocalSocket&) = delete;

  /// To be polled for input.
  std::vector<int> descriptors() const;

  /// Whether a message is complete and was not taken yet.
  bool waiting() const;

  struct Arrival {
    /// Descriptor of the connection.
    int connection = -1;
    /// The connection's name; another one for each.
    std::string client;
    std::vector<std::string> frames;
  };
  /// Accepts and reads whatever is there, without waiting. Connections that went away are added to
  /// `closed`.
  std::optional<Arrival> receive(std::vector<int>& closed);

  /// A client that does not read loses its connection.
  void send(int connection, const Reply& reply);

 private:
  struct Connection {
    std::string client;
    MessageStream stream;
  };

  void accept();
  /// False when the connection is over.
  bool read(int descriptor, Connection& connection);

  std::string file_;
  int listener_ = -1;
  int accepted_ = 0;
  /// By descriptor.
  std::map<int, Connection> connections_;
};

}  // namespace sim2vr::server

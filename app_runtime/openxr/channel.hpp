// SPDX-License-Identifier: Apache-2.0
// The socket to the harness.
#pragma once

#include <mutex>
#include <stdexcept>
#include <string>
#include <string_view>

#include "messages.hpp"

namespace sim2vr::openxr {

/// The harness closed its end, or the socket failed.
class ChannelClosed : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// One end of a stream socket, which it does not own.
class Channel {
 public:
  explicit Channel(int socket) : socket_(socket) {}
  int socket() const { return socket_; }

  /// Thread-safe. `file`: a descriptor that the other side gets with the message; -1: none. Throws
  /// ChannelClosed.
  void send(MessageKind kind, std::string_view body, int file = -1);
  /// Blocks for a whole message. Throws ChannelClosed, and wire::MalformedMessage for a length
  /// above kMaximumMessageBytes or an unknown kind.
  Message receive();
  /// From now on receive() throws ChannelClosed where nothing comes for `seconds` of real time; 0:
  /// it waits for ever.
  void limit(double seconds);
  /// Wakes a thread in receive().
  void shutdown();

 private:
  void read(char* to, std::size_t bytes);

  int socket_;
  double limit_s_ = 0.0;
  std::mutex sending_;
};

}  // namespace sim2vr::openxr

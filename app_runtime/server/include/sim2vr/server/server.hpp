// SPDX-License-Identifier: Apache-2.0
// The lockstep server: one socket, one client at a time, an answer to every message.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "sim2vr/server/app_host.hpp"

namespace sim2vr::server {

struct ServerSettings {
  /// An address for TCP ("127.0.0.1", "0.0.0.0", "::1"), or a whole endpoint ("ipc:///tmp/app").
  std::string address = "127.0.0.1";
  /// TCP port; 0 picks a free one.
  int port = 5555;
  /// Without a message for so long the session, or the wait for a first client, ends.
  std::chrono::milliseconds timeout{60'000};
  /// After a session the next client is waited for, for ever.
  bool keep = false;
  HostSettings host;

  /// The endpoint to bind.
  std::string endpoint() const;
  /// Only this machine can reach it.
  bool isLocal() const;
};

/// Asks a running server to end, from another thread or a signal handler.
class StopRequest {
 public:
  StopRequest();
  ~StopRequest();
  StopRequest(const StopRequest&) = delete;
  StopRequest& operator=(const StopRequest&) = delete;

  /// Async-signal-safe.
  void raise();
  /// Becomes readable when raised.
  int descriptor() const { return descriptor_; }
  /// Becomes true when raised.
  const std::atomic<bool>& raised() const { return raised_; }

 private:
  static_assert(std::atomic<bool>::is_always_lock_free);

  std::atomic<bool> raised_ = false;
  int descriptor_;
};

/// Why run() returned.
enum class Ending : std::uint8_t { quit, stopped, timed_out, client_vanished };

class Server {
 public:
  /// Binds the socket. Throws InvalidArgument ("port", "bind") when that is not possible and
  /// RenderError when no renderer starts.
  explicit Server(ServerSettings settings);
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  /// Where it listens, e.g. "tcp://127.0.0.1:5555".
  const std::string& endpoint() const;

  /// Serves until the session is over (every session with settings.keep) or `stop` is raised, which
  /// is looked for between the frames of a step, too. Says in the log why a session ended. `stop`
  /// outlives the server.
  Ending run(const StopRequest& stop);

 private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace sim2vr::server

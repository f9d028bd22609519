// SPDX-License-Identifier: Apache-2.0
// What one client and its apps have between them. No sockets here.
#pragma once

#include <memory>
#include <string>

#include "sim2vr/server/app_host.hpp"
#include "sim2vr/server/message.hpp"
#include "sim2vr/server/protocol2.hpp"

namespace sim2vr::server {

class Session {
 public:
  virtual ~Session() = default;

  /// Answers one message of the session's client. Does not throw for anything that a client can
  /// send: what goes wrong is the reply.
  virtual Reply answer(Frames body) = 0;
  /// After the client has quit.
  virtual bool over() const = 0;
};

struct Opening {
  /// Null when the client was refused.
  std::unique_ptr<Session> session;
  Reply reply;
  /// Why it was.
  std::string refusal;
};

/// Answers the first message of a client: a handshake of protocol 1 or a hello of protocol 2.
Opening openSession(AppHost& host, Frames body);

struct Problem {
  protocol2::Status status = protocol2::Status::engine_error;
  std::string message;
};

/// What went wrong, for use in a catch block.
Problem currentProblem();

/// "invalid_argument", as protocol 1 names it.
std::string statusName(protocol2::Status status);

/// Tells the sender of `body` about the problem, in the protocol of the message.
Reply errorReply(Frames body, const Problem& problem);

}  // namespace sim2vr::server

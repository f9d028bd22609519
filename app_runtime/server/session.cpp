#include "sim2vr/server/session.hpp"

#include <exception>
#include <new>
#include <utility>

#include "session1.hpp"
#include "session2.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::server {
namespace {

using protocol2::Status;

Opening openSession1(AppHost& host, Frames body) {
  try {
    if (body.size() != 1) {
      throw MalformedMessage("handshake: got " + std::to_string(body.size()) +
                             " frames, expected one of JSON text");
    }
    auto session = std::make_unique<Session1>(host, body[0]);
    Reply greeting = session->greeting();
    return {std::move(session), std::move(greeting), ""};
  } catch (...) {
    const Problem problem = currentProblem();
    return {nullptr, errorReply(body, problem), problem.message};
  }
}

Opening openSession2(AppHost& host, Frames body) {
  auto session = std::make_unique<Session2>(host);
  Reply reply = session->answer(body);
  if (session->open()) return {std::move(session), std::move(reply), ""};
  std::string refusal = reply.at(1);
  return {nullptr, std::move(reply), std::move(refusal)};
}

}  // namespace

Opening openSession(AppHost& host, Frames body) {
  return protocol2::isProtocol2(body) ? openSession2(host, body) : openSession1(host, body);
}

Problem currentProblem() {
  try {
    throw;
  } catch (const MalformedMessage& error) {
    return {Status::malformed_message, error.what()};
  } catch (const InvalidArgument& error) {
    return {Status::invalid_argument, error.what()};
  } catch (const runtime::Unsupported& error) {
    return {Status::unsupported, error.what()};
  } catch (const StateError& error) {
    return {Status::state_error, error.what()};
  } catch (const std::bad_alloc&) {
    return {Status::engine_error, "out of memory"};
  } catch (const std::exception& error) {
    return {Status::engine_error, error.what()};
  }
}

std::string statusName(Status status) {
  switch (status) {
    case Status::ok:
      return "ok";
    case Status::invalid_argument:
      return "invalid_argument";
    case Status::state_error:
      return "state_error";
    case Status::engine_error:
      return "engine_error";
    case Status::malformed_message:
      return "malformed_message";
    case Status::busy:
      return "busy";
    case Status::version_not_supported:
      return "version_not_supported";
    case Status::unsupported:
      return "unsupported";
  }
  return "?";
}

Reply errorReply(Frames body, const Problem& problem) {
  if (protocol2::isProtocol2(body)) {
    protocol2::Header header;
    try {
      header = protocol2::decodeHeader(body[0]);
    } catch (const MalformedMessage&) {
      // A header that cannot be read is answered with zeros.
    }
    return protocol2::encodeError(header, problem.status, problem.message);
  }
  protocol1::Observation observation;
  observation.finished = true;
  observation.error_code = statusName(problem.status);
  observation.error_message = problem.message;
  return {protocol1::encodeObservation(observation)};
}

}  // namespace sim2vr::server

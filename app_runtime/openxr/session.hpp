// SPDX-License-Identifier: Apache-2.0
// A session's states and what announces them.
#pragma once

#include <memory>

#include "objects.hpp"

namespace sim2vr::openxr {

/// Queues an event; the oldest go where too many are never polled.
void queueEvent(Instance& instance, const void* event, std::size_t bytes);
template <class T>
void queueEvent(Instance& instance, const T& event) {
  static_assert(sizeof(T) <= sizeof(XrEventDataBuffer));
  queueEvent(instance, &event, sizeof event);
}

/// Changes the state, with an event for the program and one for the harness.
void enterState(Session& session, XrSessionState state);
/// IDLE and READY of a new session.
void start(Session& session);
/// The program synchronised its frame loop: up to FOCUSED.
void show(Session& session);
/// FOCUSED, VISIBLE or SYNCHRONIZED down to STOPPING. Nothing where it is not running.
void stop(Session& session);
/// The harness is gone: STOPPING, and once the program ended the session (or does not)
/// LOSS_PENDING.
void harnessGone(Session& session);
/// LOSS_PENDING; all its calls return XR_ERROR_SESSION_LOST.
void lose(Session& session);
/// harnessGone() where the harness was lost elsewhere (a timeout).
void checkHarness(Session& session);

/// A session that is not lost. Throws Failure (XR_ERROR_HANDLE_INVALID, XR_ERROR_SESSION_LOST).
std::shared_ptr<Session> liveSession(XrSession handle);
void requireAlive(const Session& session);
/// A child of a session that is used with another one is invalid.
void requireOwn(const Session& session, const Session* parent, std::string_view child);

}  // namespace sim2vr::openxr

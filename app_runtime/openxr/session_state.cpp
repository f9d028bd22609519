// SPDX-License-Identifier: Apache-2.0
#include "session_state.hpp"

#include <cstring>

#include "check.hpp"
#include "sim2vr/xr/session_states.hpp"

namespace sim2vr::openxr {
namespace {

constexpr std::size_t kMaximumEvents = 1000;

}  // namespace

void queueEvent(Instance& instance, const void* event, std::size_t bytes) {
  XrEventDataBuffer buffer{};
  std::memcpy(&buffer, event, bytes);
  if (instance.events.size() >= kMaximumEvents) {
    XrEventDataEventsLost lost{XR_TYPE_EVENT_DATA_EVENTS_LOST, nullptr, 1};
    const XrEventDataBuffer& oldest = instance.events.front();
    if (oldest.type == XR_TYPE_EVENT_DATA_EVENTS_LOST) {
      std::memcpy(&lost, &oldest, sizeof lost);
      ++lost.lostEventCount;
      instance.events.pop_front();
    }
    instance.events.pop_front();
    XrEventDataBuffer first{};
    std::memcpy(&first, &lost, sizeof lost);
    instance.events.push_front(first);
  }
  instance.events.push_back(buffer);
}

void enterState(Session& session, XrSessionState state) {
  session.state = state;
  const XrEventDataSessionStateChanged event{XR_TYPE_EVENT_DATA_SESSION_STATE_CHANGED, nullptr,
                                             reinterpret_cast<XrSession>(session.handle), state,
                                             session.now()};
  queueEvent(*session.instance, event);
  if (Harness* harness = session.instance->harness.get()) {
    harness->note({.kind = "state", .text = xr::stateName(state), .time_ns = session.now()});
  }
}

void start(Session& session) {
  xr::toReady([&](XrSessionState state) { enterState(session, state); });
}

void show(Session& session) {
  if (session.state != XR_SESSION_STATE_READY || session.exiting) return;
  xr::toFocused([&](XrSessionState state) { enterState(session, state); });
}

void stop(Session& session) {
  if (!session.running || session.state == XR_SESSION_STATE_STOPPING) return;
  session.exiting = true;
  xr::toStopping(session.state, [&](XrSessionState state) { enterState(session, state); });
  world().changed.notify_all();
}

void harnessGone(Session& session) {
  if (session.harness_gone) return;
  session.harness_gone = true;
  session.instance->harness->lose();
  if (session.running) {
    stop(session);
  } else {
    lose(session);
  }
}

void lose(Session& session) {
  if (session.lost) return;
  session.lost = true;
  session.running = false;
  enterState(session, XR_SESSION_STATE_LOSS_PENDING);
  world().changed.notify_all();
}

void checkHarness(Session& session) {
  const Harness* harness = session.instance->harness.get();
  if (harness != nullptr && harness->lost()) harnessGone(session);
}

void requireAlive(const Session& session) {
  if (session.lost) {
    throw Failure(XR_ERROR_SESSION_LOST, session.harness_gone
                                             ? "the harness is gone or waited in vain; destroy "
                                               "the session"
                                             : "the session is lost");
  }
}

void requireOwn(const Session& session, const Session* parent, std::string_view child) {
  if (parent != &session) invalid(std::string(child) + " belongs to another session");
}

std::shared_ptr<Session> liveSession(XrSession handle) {
  auto session = get<Session>(handle, "session");
  checkHarness(*session);
  requireAlive(*session);
  return session;
}

}  // namespace sim2vr::openxr

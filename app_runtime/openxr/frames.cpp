// SPDX-License-Identifier: Apache-2.0
// xrWaitFrame, xrBeginFrame, xrEndFrame.
#include <algorithm>

#include "calls.hpp"
#include "check.hpp"
#include "gate.hpp"
#include "layers.hpp"
#include "session_state.hpp"

namespace sim2vr::openxr {
namespace {

void requireRunning(const Session& session) {
  if (!session.running) throw Failure(XR_ERROR_SESSION_NOT_RUNNING, "the session does not run");
}

void expect(Session& session, const char* call, const char* cause) {
  if (Harness* harness = session.instance->harness.get(); harness != nullptr && !session.exiting) {
    harness->expect(call, cause);
  }
}

/// One thread waits at a time, and only after the frame before has begun.
void awaitTurn(Session& session, Lock& lock) {
  FrameLoop& loop = session.loop;
  while (loop.waiting || loop.waited) {
    world().changed.wait(lock);
    checkHarness(session);
    requireAlive(session);
    requireRunning(session);
    if (session.destroyed) throw Failure(XR_ERROR_HANDLE_INVALID, "the session was destroyed");
  }
}

/// Ends the turn however the wait ends.
class Turn {
 public:
  explicit Turn(FrameLoop& loop) : loop_(loop) { loop_.waiting = true; }
  ~Turn() {
    loop_.waiting = false;
    world().changed.notify_all();
  }
  Turn(const Turn&) = delete;
  Turn& operator=(const Turn&) = delete;

 private:
  FrameLoop& loop_;
};

}  // namespace

XrResult XRAPI_CALL calls::xrWaitFrame(XrSession session, const XrFrameWaitInfo* frameWaitInfo,
                                       XrFrameState* frameState) {
  return guarded("xrWaitFrame", [&](Lock& lock) {
    const auto self = liveSession(session);
    optionalStructure(frameWaitInfo, XR_TYPE_FRAME_WAIT_INFO, "frameWaitInfo");
    auto& state = structure(frameState, XR_TYPE_FRAME_STATE, "frameState");
    requireRunning(*self);
    awaitTurn(*self, lock);
    const Turn turn(self->loop);
    const std::optional<xr::Frame> frame = nextFrame(*self, lock);
    if (self->destroyed) throw Failure(XR_ERROR_HANDLE_INVALID, "the session was destroyed");
    requireRunning(*self);
    self->loop.waited = true;
    ++self->loop.waited_frames;
    if (frame) show(*self);
    const XrDuration period = self->instance->config.period_ns();
    // Frames of a session that stops have later times, too.
    state.predictedDisplayTime =
        frame ? frame->time : self->now() + period * std::max(self->frames_after_stop, 1U);
    state.predictedDisplayPeriod = period;
    state.shouldRender = self->state == XR_SESSION_STATE_VISIBLE || self->focused();
    expect(*self, "xrBeginFrame", "xrBeginFrame did not follow xrWaitFrame");
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrBeginFrame(XrSession session, const XrFrameBeginInfo* frameBeginInfo) {
  return guarded("xrBeginFrame", [&](Lock&) {
    const auto self = liveSession(session);
    optionalStructure(frameBeginInfo, XR_TYPE_FRAME_BEGIN_INFO, "frameBeginInfo");
    requireRunning(*self);
    FrameLoop& loop = self->loop;
    if (!loop.waited) {
      throw Failure(XR_ERROR_CALL_ORDER_INVALID, "xrWaitFrame has to be called before");
    }
    const bool discards = loop.begun;
    loop.waited = false;
    if (discards) frameDone(*self, nullptr);
    loop.begun = true;
    world().changed.notify_all();
    expect(*self, "xrEndFrame", "xrEndFrame did not follow xrBeginFrame");
    return discards ? XR_FRAME_DISCARDED : XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrEndFrame(XrSession session, const XrFrameEndInfo* frameEndInfo) {
  return guarded("xrEndFrame", [&](Lock&) {
    const auto self = liveSession(session);
    const auto& info = structure(frameEndInfo, XR_TYPE_FRAME_END_INFO, "frameEndInfo");
    requireRunning(*self);
    if (!self->loop.begun) {
      throw Failure(XR_ERROR_CALL_ORDER_INVALID, "xrBeginFrame has to be called before");
    }
    requireTime(info.displayTime, "frameEndInfo->displayTime");
    if (info.environmentBlendMode != XR_ENVIRONMENT_BLEND_MODE_OPAQUE) {
      throw Failure(XR_ERROR_ENVIRONMENT_BLEND_MODE_UNSUPPORTED,
                    fmt::format("environmentBlendMode is {}, expected OPAQUE (1)",
                                static_cast<int>(info.environmentBlendMode)));
    }
    checkLayers(*self, info);
    frameDone(*self, &info);
    self->loop.begun = false;
    return XR_SUCCESS;
  });
}

}  // namespace sim2vr::openxr

// SPDX-License-Identifier: Apache-2.0
#include "gate.hpp"

#include <dlfcn.h>

#include <ctime>

#include "layers.hpp"
#include "real_time.hpp"
#include "session_state.hpp"

namespace sim2vr::openxr {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
/// How long a program whose harness is gone may go on with empty frames.
constexpr XrDuration kGrace_ns = kSecond_ns;

std::int64_t monotonic_ns() {
  struct timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * kSecond_ns + now.tv_nsec;
}

/// Sets the program's clocks, where the harness has preloaded virtual ones (preload/clock.c).
void advanceClock(XrTime time) {
  using Advance = void (*)(std::int64_t);
  static const auto advance =
      reinterpret_cast<Advance>(::dlsym(RTLD_DEFAULT, "sim2vr_clock_advance"));
  if (advance != nullptr) advance(time);
}

/// Someone who stands still, for programs without a harness.
xr::DeviceState standing() {
  xr::DeviceState state;
  state.head.position = {0.0F, 1.6F, 0.0F};
  for (const xr::Hand hand : xr::kHands) {
    xr::ControllerState& controller = state.hand(hand);
    controller.active = true;
    controller.grip.position = {hand == xr::Hand::left ? -0.2F : 0.2F, 1.2F, -0.4F};
    controller.aim = xr::compose(controller.grip, xr::kGripToAim);
  }
  return state;
}

/// Without the lock.
void sleep(Lock& lock, std::int64_t duration_ns) {
  lock.unlock();
  realSleep(duration_ns);
  lock.lock();
}

xr::Frame realTimeFrame(Session& session, Lock& lock) {
  const XrDuration period = session.instance->config.period_ns();
  // The display shows a picture one period after the program may begin with it.
  const xr::Frame* latest = session.tracking.latest();
  const XrTime next = latest == nullptr ? 0 : latest->time;
  const std::int64_t now = monotonic_ns();
  if (next > now) sleep(lock, std::min<std::int64_t>(next - now, period));
  const std::int64_t start = std::max<std::int64_t>(monotonic_ns(), next);
  return {start + period, standing()};
}

bool ended(const Session& session) {
  return session.lost || session.destroyed || session.instance->harness->lost();
}

/// Waits until the frame before was ended, by whatever thread.
void awaitEnd(Session& session, Lock& lock) {
  FrameLoop& loop = session.loop;
  if (loop.done_frames == loop.waited_frames) return;
  session.instance->harness->expect(
      "xrWaitFrame",
      "program waits for a frame before it ended the last: use gate: pipelined; xrEndFrame did not "
      "come");
  while (loop.done_frames != loop.waited_frames && !ended(session)) {
    world().changed.wait(lock);
  }
}

/// In pipelined lockstep a step is answered when the program wants the next, with the picture of
/// the frame before the last one: the last may still be drawn.
void answer(Session& session, const Picture& picture) {
  StepProgress& step = session.step;
  if (!step.open) return;
  step.open = false;
  Answer message;
  message.frames_shown = step.shown;
  message.layers = step.layers;
  message.should_render = session.state == XR_SESSION_STATE_FOCUSED;
  session.instance->harness->answer(std::move(message), picture);
}

/// Asks the harness for a step. False: the session stops.
bool takeStep(Session& session, Lock& lock) {
  const std::shared_ptr<Harness> harness = session.instance->harness;
  std::optional<Step> next;
  harness->relax();
  lock.unlock();
  try {
    next = harness->nextStep();
  } catch (...) {
    lock.lock();
    throw;
  }
  lock.lock();
  if (!next) {
    stop(session);
    return false;
  }
  StepProgress& step = session.step;
  step.frames.assign(std::make_move_iterator(next->frames.begin()),
                     std::make_move_iterator(next->frames.end()));
  step.image_wanted = next->image_wanted;
  step.open = true;
  // Pipelined, the last frame may still be drawn when the step is answered.
  step.shown =
      session.instance->config.pipelined ? static_cast<std::uint32_t>(step.frames.size()) : 0;
  step.layers = 0;
  return true;
}

std::optional<xr::Frame> lockstepFrame(Session& session, Lock& lock) {
  StepProgress& step = session.step;
  if (step.frames.empty()) {
    if (session.instance->config.pipelined) {
      answer(session, session.pictures[(session.loop.waited_frames + 1) % 2]);
    } else {
      awaitEnd(session, lock);
    }
    checkHarness(session);
    if (session.exiting || session.lost || session.destroyed) return std::nullopt;
    if (!takeStep(session, lock)) return std::nullopt;
  }
  xr::Frame frame = std::move(step.frames.front());
  step.frames.pop_front();
  return frame;
}

/// Empty frames at the display's pace while the program takes its leave.
std::optional<xr::Frame> stoppingFrame(Session& session, Lock& lock) {
  const XrDuration period = session.instance->config.period_ns();
  ++session.frames_after_stop;
  if (session.harness_gone && session.frames_after_stop * period > kGrace_ns) {
    lose(session);
    requireAlive(session);
  }
  if (session.frames_after_stop > 1) sleep(lock, period);
  return std::nullopt;
}

bool pictureWanted(const Session& session) {
  const Instance& instance = *session.instance;
  if (!instance.harness || !instance.config.images || !session.graphics) return false;
  // Pipelined: whether the next step wants this one is not known yet.
  if (instance.config.pipelined) return session.step.frames.size() <= 1;
  return session.step.image_wanted && session.step.frames.empty();
}

}  // namespace

std::optional<xr::Frame> nextFrame(Session& session, Lock& lock) {
  std::optional<xr::Frame> frame;
  if (!session.instance->harness) {
    frame = realTimeFrame(session, lock);
  } else {
    try {
      if (!session.exiting) frame = lockstepFrame(session, lock);
    } catch (const std::runtime_error& error) {
      const auto* failure = dynamic_cast<const Failure*>(&error);
      if (failure != nullptr) throw;
      report(std::string("sim2vr OpenXR: xrWaitFrame: ") + error.what());
      session.instance->harness->ended(error.what(), "xrWaitFrame");
      harnessGone(session);
    }
    requireAlive(session);
    if (!frame) return stoppingFrame(session, lock);
    advanceClock(frame->time);
    session.monotonic_offset_ns = frame->time - monotonic_ns();
  }
  session.tracking.track(*frame);
  return frame;
}

void runHeadless(Session& session) {
  if (session.instance->harness) return;
  session.tracking.track({monotonic_ns() + session.instance->config.period_ns(), standing()});
  show(session);
}

void frameDone(Session& session, const XrFrameEndInfo* info) {
  FrameLoop& loop = session.loop;
  Picture picture;
  // Pixels are read before the frame counts as done: they may throw.
  if (info != nullptr && info->layerCount > 0 && pictureWanted(session)) {
    picture = composePicture(session, *info);
  }
  ++loop.done_frames;
  world().changed.notify_all();
  const std::shared_ptr<Harness>& harness = session.instance->harness;
  if (!harness) return;
  if (info != nullptr) {
    if (!session.instance->config.pipelined) ++session.step.shown;
    session.step.layers = info->layerCount;
  }
  session.pictures[loop.done_frames % 2] = std::move(picture);
  const bool last = session.step.frames.empty() && loop.done_frames == loop.waited_frames;
  try {
    if (last && !session.instance->config.pipelined) {
      answer(session, session.pictures[loop.done_frames % 2]);
    }
  } catch (const std::runtime_error& error) {
    report(std::string("sim2vr OpenXR: xrEndFrame: ") + error.what());
    harnessGone(session);
    return;
  }
  if (last && !session.exiting) {
    harness->expect("xrWaitFrame", "xrWaitFrame did not follow xrEndFrame");
  }
}

}  // namespace sim2vr::openxr

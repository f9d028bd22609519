#include "sim2vr/xr/session.hpp"

#include <cmath>

#include "names.hpp"
#include "sim2vr/core/errors.hpp"
#include "xr_archive.hpp"

namespace sim2vr::xr {

void SessionSettings::validate() const {
  if (!(ipd_m >= 0.0F && ipd_m <= 0.2F)) {
    throw InvalidArgument("ipd_m", std::to_string(ipd_m), "metres from 0 to 0.2");
  }
  if (!(vertical_fov_deg > 0.0F && vertical_fov_deg < 180.0F)) {
    throw InvalidArgument("vertical_fov_deg", std::to_string(vertical_fov_deg),
                          "degrees above 0 and below 180");
  }
  if (!(aspect > 0.0F && std::isfinite(aspect))) {
    throw InvalidArgument("aspect", std::to_string(aspect), "width / height above 0");
  }
}

Session::Session(Device& device, const SessionSettings& settings)
    : device_(device), settings_(settings) {
  settings_.validate();
  enter(XR_SESSION_STATE_IDLE);
  enter(XR_SESSION_STATE_READY);
}

Session::~Session() = default;

void Session::enter(XrSessionState state) {
  state_ = state;
  events_.emplace_back(state, frame_time_);
}

bool Session::isRunning() const {
  return state_ == XR_SESSION_STATE_SYNCHRONIZED || state_ == XR_SESSION_STATE_VISIBLE ||
         state_ == XR_SESSION_STATE_FOCUSED || state_ == XR_SESSION_STATE_STOPPING;
}

std::optional<XrEventDataSessionStateChanged> Session::pollEvent() {
  if (events_.empty()) return std::nullopt;
  const auto [state, time] = events_.front();
  events_.pop_front();
  return XrEventDataSessionStateChanged{XR_TYPE_EVENT_DATA_SESSION_STATE_CHANGED, nullptr,
                                        XR_NULL_HANDLE, state, time};
}

void Session::begin() {
  if (state_ != XR_SESSION_STATE_READY) {
    throw StateError(std::string("begin: the session is ") + stateName(state_) +
                     "; it can begin only when READY");
  }
  any_frame_ = false;
  frame_stage_ = FrameStage::idle;
  enter(XR_SESSION_STATE_SYNCHRONIZED);
}

void Session::requestExit() {
  requireRunning("requestExit");
  if (state_ == XR_SESSION_STATE_STOPPING) {
    throw StateError("requestExit: the session is STOPPING already; call end");
  }
  if (state_ == XR_SESSION_STATE_FOCUSED) enter(XR_SESSION_STATE_VISIBLE);
  if (state_ == XR_SESSION_STATE_VISIBLE) enter(XR_SESSION_STATE_SYNCHRONIZED);
  enter(XR_SESSION_STATE_STOPPING);
}

void Session::end() {
  if (state_ != XR_SESSION_STATE_STOPPING) {
    throw StateError(std::string("end: the session is ") + stateName(state_) +
                     "; it can end only when STOPPING (call requestExit first)");
  }
  enter(XR_SESSION_STATE_IDLE);
  enter(XR_SESSION_STATE_EXITING);
}

void Session::setInputFocus(bool focused) {
  if (focused && state_ == XR_SESSION_STATE_VISIBLE) enter(XR_SESSION_STATE_FOCUSED);
  if (!focused && state_ == XR_SESSION_STATE_FOCUSED) enter(XR_SESSION_STATE_VISIBLE);
}

void Session::requireRunning(const char* call) const {
  if (isRunning()) return;
  throw StateError(std::string(call) + ": the session is " + stateName(state_) +
                   "; it must be running (call begin when READY)");
}

void Session::requireStage(const char* call, FrameStage stage, const char* expected) const {
  requireRunning(call);
  if (frame_stage_ == stage) return;
  throw StateError(std::string(call) + ": call " + expected + " first (session " +
                   stateName(state_) + "; the order is waitFrame, beginFrame, endFrame)");
}

XrFrameState Session::waitFrame(XrTime predicted_display_time, XrDuration period) {
  const char* missing = frame_stage_ == FrameStage::waited ? "beginFrame" : "endFrame";
  requireStage("waitFrame", FrameStage::idle, missing);
  if (any_frame_ && predicted_display_time < frame_time_) {
    throw InvalidArgument("predicted_display_time", std::to_string(predicted_display_time),
                          "a time not before the previous frame's " + std::to_string(frame_time_));
  }
  if (period < 0) {
    throw InvalidArgument("period", std::to_string(period), "a duration of 0 ns or more");
  }
  frame_time_ = predicted_display_time;
  frame_stage_ = FrameStage::waited;
  sampled_ = false;
  if (!any_frame_) {
    any_frame_ = true;
    recenter();
    if (state_ == XR_SESSION_STATE_SYNCHRONIZED) {
      enter(XR_SESSION_STATE_VISIBLE);
      enter(XR_SESSION_STATE_FOCUSED);
    }
  }
  const bool seen = state_ == XR_SESSION_STATE_VISIBLE || state_ == XR_SESSION_STATE_FOCUSED;
  return {XR_TYPE_FRAME_STATE, nullptr, predicted_display_time, period, seen ? 1U : 0U};
}

void Session::beginFrame() {
  requireStage("beginFrame", FrameStage::waited, "waitFrame");
  frame_stage_ = FrameStage::begun;
}

void Session::endFrame() {
  requireStage("endFrame", FrameStage::begun, "beginFrame");
  frame_stage_ = FrameStage::idle;
}

const DeviceState& Session::sampleFrame() {
  if (!sampled_) {
    sample_ = device_.sample(frame_time_);
    sampled_ = true;
  }
  return sample_;
}

DeviceState Session::sampleAt(XrTime time) {
  return time == frame_time_ ? sampleFrame() : device_.sample(time);
}

void Session::fields(Archive& archive) {
  archive.field("session_state", state_, XR_SESSION_STATE_EXITING);
  std::vector<std::pair<XrSessionState, XrTime>> events(events_.begin(), events_.end());
  archive.field("events", events);
  if (archive.loading()) {
    for (const auto& [state, time] : events) {
      if (state < XR_SESSION_STATE_UNKNOWN || state > XR_SESSION_STATE_EXITING) {
        throw EngineError("saved state: field 'events': got session state " +
                          std::to_string(state) + ", expected 0 to " +
                          std::to_string(XR_SESSION_STATE_EXITING));
      }
    }
    events_.assign(events.begin(), events.end());
  }
  archive.field("frame_stage", frame_stage_, FrameStage::begun);
  archive.field("frame_time", frame_time_);
  archive.field("any_frame", any_frame_);
  fieldsOfActions(archive);
  archive.field("sampled", sampled_);
  archive.field("sample", sample_);
  poseField(archive, "stage_T_local", stage_T_local_);
  device_.fields(archive);
}

}  // namespace sim2vr::xr

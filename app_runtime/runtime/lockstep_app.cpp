// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/runtime/lockstep_app.hpp"

#include <algorithm>
#include <array>

namespace sim2vr::runtime {
namespace {

constexpr std::array<std::string_view, 12> kCapabilityNames{
    "save",   "views",        "frames",   "inputs",     "left_controller", "haptics",
    "sounds", "head_request", "two_eyes", "privileged", "scene",           "observers"};

bool atRest(const xr::ControllerState& hand) {
  return hand.trigger == 0.0F && hand.squeeze == 0.0F && hand.thumbstick.x == 0.0F &&
         hand.thumbstick.y == 0.0F && !hand.thumbstick_click && !hand.a && !hand.b && !hand.x &&
         !hand.y && !hand.menu && !hand.trigger_touch && !hand.thumbstick_touch &&
         !hand.lower_touch && !hand.upper_touch && !hand.thumbrest_touch;
}

}  // namespace

void AppSettings::validate() const {
  render::checkImageSize(headset_size);
  if (eyes != 1 && eyes != 2) throw InvalidArgument("eyes", std::to_string(eyes), "1 or 2");
  time.validate();
}

View viewFromName(std::string_view name) {
  static const std::array<std::string, 3> kNames{"headset", "recorder", "spectator"};
  const auto found = std::find(kNames.begin(), kNames.end(), name);
  if (found == kNames.end()) {
    throw InvalidArgument("view", "'" + std::string(name) + "'", oneOf(kNames, name));
  }
  return static_cast<View>(found - kNames.begin());
}

std::string_view capabilityName(Capability capability) {
  return kCapabilityNames.at(static_cast<std::size_t>(capability));
}

std::vector<std::string> capabilityNames(const Capabilities& capabilities) {
  std::vector<std::string> names;
  for (const Capability each : capabilities) names.emplace_back(capabilityName(each));
  return names;
}

Unsupported::Unsupported(Capability capability)
    : EngineError(std::string(capabilityName(capability)) +
                  ": the app does not have this capability"),
      capability_(capability) {}

void LockstepApp::requireInput(const xr::DeviceState& devices) const {
  const auto require = [this](Capability capability, bool asked) {
    if (asked && !can(capability)) throw Unsupported(capability);
  };
  const xr::ControllerState& left = devices.hand(xr::Hand::left);
  const xr::ControllerState& right = devices.hand(xr::Hand::right);
  require(Capability::left_controller, left.active);
  require(Capability::inputs, (left.active && !atRest(left)) || (right.active && !atRest(right)));
}

void LockstepApp::throwIfStopped() const {
  if (stop_ == nullptr || !stop_->load(std::memory_order_relaxed)) return;
  throw Interrupted("the app was asked to end");
}

Outcome LockstepApp::begin(const RoundStart& start, const xr::DeviceState& devices) {
  throwIfStopped();
  requireInput(devices);
  return doBegin(start, devices);
}

void LockstepApp::startStep(std::span<const FrameInput> frames, int drawn) {
  if (frames.empty()) throw InvalidArgument("frames", "none", "at least one frame");
  const auto last = static_cast<int>(frames.size()) - 1;
  if (drawn != kLastFrame && (drawn < 0 || drawn > last)) {
    throw InvalidArgument("drawn", std::to_string(drawn),
                          "0 to " + std::to_string(last) + ", or -1 for the last frame");
  }
  if (last > 0 && !can(Capability::frames)) throw Unsupported(Capability::frames);
  for (const FrameInput& frame : frames) requireInput(frame.devices);
  throwIfStopped();
  doStartStep(frames, static_cast<std::size_t>(drawn == kLastFrame ? last : drawn));
}

StepResult LockstepApp::reset(const RoundStart& start, const xr::DeviceState& devices) {
  const Outcome outcome = begin(start, devices);
  draw();
  return {outcome.reward, outcome.finished, outcome.time_feature, log(), events()};
}

StepResult LockstepApp::step(std::span<const FrameInput> frames, int drawn) {
  startStep(frames, drawn);
  draw();
  const Outcome outcome = finishStep();
  return {outcome.reward, outcome.finished, outcome.time_feature, log(), events()};
}

const std::vector<std::string>& LockstepApp::privilegedNames() const {
  static const std::vector<std::string> none;
  return none;
}

void LockstepApp::fillPrivileged(std::span<float>) const {
  throw Unsupported(Capability::privileged);
}

std::optional<double> LockstepApp::headRequest(const RoundStart&) const {
  throw Unsupported(Capability::head_request);
}

void LockstepApp::renderView(View, render::ImageSize, std::span<std::uint8_t>) {
  throw Unsupported(Capability::views);
}

void LockstepApp::renderFrom(const Pose&, double, render::ImageSize, std::span<std::uint8_t>,
                             std::span<float>) {
  throw Unsupported(Capability::observers);
}

std::vector<render::Shown> LockstepApp::shown() { throw Unsupported(Capability::scene); }

const render::Mesh& LockstepApp::shownMesh(int) const { throw Unsupported(Capability::scene); }

std::string LockstepApp::save() { throw Unsupported(Capability::save); }

void LockstepApp::load(const std::string&) { throw Unsupported(Capability::save); }

std::uint64_t LockstepApp::stateHash() { throw Unsupported(Capability::save); }

}  // namespace sim2vr::runtime

// SPDX-License-Identifier: Apache-2.0
// An app with a loop of its own, as small as it can be: no game, no scene, no renderer, and of the
// capabilities those that a test gives it.
#pragma once

#include <algorithm>
#include <cstring>

#include "sim2vr/runtime/lockstep_app.hpp"

namespace sim2vr::runtime::testing {

/// Counts frames; the reward of each is the head's height, the picture is grey of the frame's
/// number, and a pulled trigger is answered with a pulse.
class OwnLoop final : public LockstepApp {
 public:
  OwnLoop(AppSettings settings, Capabilities capabilities, std::span<std::uint8_t> image)
      : settings_(std::move(settings)), capabilities_(std::move(capabilities)), image_(image) {
    settings_.validate();
    if (settings_.eyes == 2 && !can(Capability::two_eyes)) throw Unsupported(Capability::two_eyes);
    if (image_.empty()) {
      own_image_.resize(settings_.imageBytes());
      image_ = own_image_;
    }
  }

  /// With these capabilities; `save` among them is meant.
  static AppFactory factory(Capabilities capabilities = {}) {
    return [capabilities](const AppSettings& settings, const std::shared_ptr<render::Renderer>&,
                          std::span<std::uint8_t> image) {
      return std::make_unique<OwnLoop>(settings, capabilities, image);
    };
  }

  const AppSettings& settings() const override { return settings_; }
  const Capabilities& capabilities() const override { return capabilities_; }
  std::string rendererDescription() const override { return "paints grey"; }

  Outcome finishStep() override {
    const Outcome outcome = runTo(frames_.size());
    events_ = std::exchange(coming_, {});
    return outcome;
  }

  std::span<const std::uint8_t> image() const override { return image_; }
  const std::map<std::string, double>& log() const override { return log_; }
  const Events& events() const override { return events_; }

  std::string save() override {
    if (!can(Capability::save)) return LockstepApp::save();
    return std::to_string(number_);
  }
  void load(const std::string& state) override {
    if (!can(Capability::save)) return LockstepApp::load(state);
    number_ = std::stoi(state);
    paint();
  }
  std::uint64_t stateHash() override {
    if (!can(Capability::save)) return LockstepApp::stateHash();
    return static_cast<std::uint64_t>(number_);
  }

 private:
  Outcome doBegin(const RoundStart& start, const xr::DeviceState& devices) override {
    number_ = static_cast<int>(start.seed) - 1;
    frames_ = {{start.time_ns, devices}};
    run_ = 0;
    coming_ = {};
    runTo(1);
    paint();
    return finishStep();
  }

  void doStartStep(std::span<const FrameInput> frames, std::size_t drawn) override {
    frames_.assign(frames.begin(), frames.end());
    run_ = 0;
    reward_ = 0.0F;
    runTo(drawn + 1);
    paint();
  }

  Outcome runTo(std::size_t end) {
    for (; run_ < end; ++run_) {
      const xr::DeviceState& devices = frames_[run_].devices;
      ++number_;
      reward_ += devices.head.position.y;
      const float trigger = devices.hand(xr::Hand::right).trigger;
      if (trigger > 0.0F) coming_.haptics.push_back({xr::Hand::right, trigger, 100.0F, -1});
    }
    log_["Frames"] = number_;
    return {reward_, false, 0.0F};
  }

  void paint() { std::memset(image_.data(), number_ & 0xFF, image_.size()); }

  AppSettings settings_;
  Capabilities capabilities_;
  std::vector<std::uint8_t> own_image_;
  std::span<std::uint8_t> image_;
  std::map<std::string, double> log_;
  Events events_, coming_;
  std::vector<FrameInput> frames_;
  std::size_t run_ = 0;
  int number_ = 0;
  float reward_ = 0.0F;
};

}  // namespace sim2vr::runtime::testing

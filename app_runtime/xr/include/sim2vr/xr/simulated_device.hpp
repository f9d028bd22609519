// The device that a simulated user wears: the harness sets its state before each user step.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "sim2vr/xr/device.hpp"

namespace sim2vr::xr {

class SimulatedDevice final : public Device {
 public:
  std::string_view name() const override { return "simulated"; }

  /// Replaces the whole state. Throws as validated() does and then keeps the old state.
  void set(const DeviceState& state);
  void setHead(const XrPosef& stage_T_head);
  void setController(Hand hand, const ControllerState& state);
  const DeviceState& state() const { return state_; }

  DeviceState sample(XrTime) override { return state_; }

  /// The latest vibration that the app asked for; amplitude 0 when there was none.
  void haptic(Hand hand, const XrHapticVibration& vibration) override;
  const XrHapticVibration& lastHaptic(Hand hand) const;
  /// Vibrations asked for so far.
  std::uint64_t hapticCount(Hand hand) const;
  /// The vibrations asked for since the last call, in order. Not part of saved states.
  std::vector<HapticPulse> takePulses();

  void fields(Archive& archive) override;

 private:
  struct HapticChannel {
    XrHapticVibration last{XR_TYPE_HAPTIC_VIBRATION, nullptr, 0, 0.0F, 0.0F};
    std::uint64_t count = 0;
    void fields(Archive& archive);
  };

  DeviceState state_;
  std::array<HapticChannel, 2> haptics_;
  std::vector<HapticPulse> pulses_;
};

}  // namespace sim2vr::xr

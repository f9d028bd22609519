#include "sim2vr/xr/simulated_device.hpp"

#include <utility>

namespace sim2vr::xr {

void SimulatedDevice::set(const DeviceState& state) { state_ = validated(state); }

void SimulatedDevice::setHead(const XrPosef& stage_T_head) {
  DeviceState next = state_;
  next.head = stage_T_head;
  set(next);
}

void SimulatedDevice::setController(Hand hand, const ControllerState& state) {
  DeviceState next = state_;
  next.hand(hand) = state;
  set(next);
}

void SimulatedDevice::haptic(Hand hand, const XrHapticVibration& vibration) {
  HapticChannel& channel = haptics_[static_cast<std::size_t>(hand)];
  channel.last = vibration;
  channel.last.next = nullptr;
  if (vibration.amplitude > 0.0F) ++channel.count;
  pulses_.push_back({hand, vibration.amplitude, vibration.frequency, vibration.duration});
}

std::vector<HapticPulse> SimulatedDevice::takePulses() { return std::exchange(pulses_, {}); }

const XrHapticVibration& SimulatedDevice::lastHaptic(Hand hand) const {
  return haptics_[static_cast<std::size_t>(hand)].last;
}

std::uint64_t SimulatedDevice::hapticCount(Hand hand) const {
  return haptics_[static_cast<std::size_t>(hand)].count;
}

void SimulatedDevice::HapticChannel::fields(Archive& archive) {
  archive.field("duration", last.duration);
  archive.field("frequency", last.frequency);
  archive.field("amplitude", last.amplitude);
  archive.field("count", count);
}

void SimulatedDevice::fields(Archive& archive) {
  archive.field("simulated_device", state_);
  archive.field("haptics", haptics_);
}

}  // namespace sim2vr::xr

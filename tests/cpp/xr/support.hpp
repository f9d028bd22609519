// A session with a simulated device, and shorthands.
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <vector>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/xr/session.hpp"
#include "sim2vr/xr/simulated_device.hpp"

namespace sim2vr::xr {

constexpr XrDuration kPeriod = 50'000'000;

/// Counts how often it was sampled.
class CountingDevice final : public Device {
 public:
  std::string_view name() const override { return "counting"; }
  DeviceState sample(XrTime time) override {
    times.push_back(time);
    return state;
  }

  DeviceState state;
  std::vector<XrTime> times;
};

inline void frame(Session& session, XrTime time) {
  session.waitFrame(time, kPeriod);
  session.beginFrame();
  session.endFrame();
}

inline std::vector<XrSessionState> drain(Session& session) {
  std::vector<XrSessionState> states;
  while (const auto event = session.pollEvent()) states.push_back(event->state);
  return states;
}

template <class Error>
std::string errorOf(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "none";
}

inline ControllerState activeController() {
  ControllerState state;
  state.active = true;
  return state;
}

inline void expectPose(const XrPosef& got, const XrPosef& expected, float tolerance = 1e-6F) {
  EXPECT_NEAR(got.position.x, expected.position.x, tolerance);
  EXPECT_NEAR(got.position.y, expected.position.y, tolerance);
  EXPECT_NEAR(got.position.z, expected.position.z, tolerance);
  const XrQuaternionf& a = got.orientation;
  const XrQuaternionf& b = expected.orientation;
  const float dot = a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w;
  EXPECT_NEAR(std::abs(dot), 1.0F, tolerance)
      << a.x << " " << a.y << " " << a.z << " " << a.w << " is another rotation";
}

}  // namespace sim2vr::xr

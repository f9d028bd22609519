// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/clock.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>

#include "sim2vr/core/errors.hpp"

namespace sim2vr {
namespace {

constexpr double kNsPerSecond = 1e9;
// Beyond these a single frame would keep the app busy for minutes.
constexpr double kShortestFixedStep_s = 1e-5;
constexpr double kMaximumFixedSteps = 1e7;
/// Some 30 years.
constexpr std::int64_t kLatest_ns = 1'000'000'000'000'000'000;

void requirePositive(const char* field, double value) {
  if (!(std::isfinite(value) && value > 0.0)) {
    throw InvalidArgument(field, std::to_string(value), "a finite number above 0");
  }
}

float toSeconds(double ns) { return static_cast<float>(ns / kNsPerSecond); }

}  // namespace

void TimeSettings::validate() const {
  requirePositive("fixed_delta_time_s", fixed_delta_time_s);
  requirePositive("maximum_delta_time_s", maximum_delta_time_s);
  requirePositive("time_scale", time_scale);
  requirePositive("target_frame_rate", target_frame_rate);
  if (fixed_delta_time_s < kShortestFixedStep_s) {
    throw InvalidArgument("fixed_delta_time_s", fmt::format("{}", fixed_delta_time_s),
                          "1e-5 s or above");
  }
  if (maximum_delta_time_s > kMaximumFixedSteps * fixed_delta_time_s) {
    throw InvalidArgument("maximum_delta_time_s", fmt::format("{}", maximum_delta_time_s),
                          "1e7 fixed steps at most");
  }
  if (!(fixed_step_tolerance_s >= 0.0 && fixed_step_tolerance_s < fixed_delta_time_s)) {
    throw InvalidArgument("fixed_step_tolerance_s", std::to_string(fixed_step_tolerance_s),
                          "a number from 0 to below fixed_delta_time_s");
  }
}

std::int64_t lockstepFrameTimeNs(std::int64_t frame, int frame_rate_hz) {
  if (frame < 0) throw InvalidArgument("frame", std::to_string(frame), "0 or above");
  if (frame_rate_hz < 1) {
    throw InvalidArgument("frame_rate_hz", std::to_string(frame_rate_hz), "1 or above");
  }
  const double exact_s = 1.0 / frame_rate_hz;
  auto period_s = static_cast<float>(exact_s);
  if (static_cast<double>(period_s) >= exact_s) period_s = std::nextafter(period_s, 0.0F);
  return std::llround(static_cast<double>(frame) * static_cast<double>(period_s) * kNsPerSecond);
}

GameClock::GameClock(const TimeSettings& settings) : settings_(settings) {
  settings_.validate();
  restart();
}

void GameClock::restart(std::int64_t start_ns) {
  time_ns_ = start_ns;
  caller_time_ns_ = start_ns;
  delta_ns_ = 0;
  frame_count_ = 0;
  in_fixed_step_ = false;
  fixed_step_ = lastFixedStep();
}

std::int64_t GameClock::lastFixedStep() const {
  const double tolerance_ns = settings_.fixed_step_tolerance_s * kNsPerSecond;
  return static_cast<std::int64_t>(
      std::floor((static_cast<double>(time_ns_) + tolerance_ns) / fixedPeriodNs()));
}

void GameClock::beginFrame(std::int64_t frame_time_ns) {
  if (frame_time_ns < caller_time_ns_) {
    throw InvalidArgument("time_ns", std::to_string(frame_time_ns),
                          "a time not before the previous frame's " +
                              std::to_string(caller_time_ns_) + " (clocks must not go backwards)");
  }
  const auto maximum_ns = std::llround(settings_.maximum_delta_time_s * kNsPerSecond);
  delta_ns_ = std::min<std::int64_t>(frame_time_ns - caller_time_ns_, maximum_ns);
  time_ns_ += delta_ns_;
  caller_time_ns_ = frame_time_ns;
  ++frame_count_;
}

bool GameClock::beginFixedStep() {
  const double next_ns = static_cast<double>(fixed_step_ + 1) * fixedPeriodNs();
  const double limit_ns =
      static_cast<double>(time_ns_) + settings_.fixed_step_tolerance_s * kNsPerSecond;
  if (next_ns > limit_ns) return false;
  ++fixed_step_;
  in_fixed_step_ = true;
  return true;
}

float GameClock::time() const {
  return in_fixed_step_ ? fixedTime() : toSeconds(static_cast<double>(time_ns_));
}

float GameClock::deltaTime() const {
  return in_fixed_step_ ? fixedDeltaTime() : toSeconds(static_cast<double>(delta_ns_));
}

float GameClock::fixedTime() const {
  return toSeconds(static_cast<double>(fixed_step_) * fixedPeriodNs());
}

void GameClock::fields(Archive& archive) {
  archive.field("fixed_delta_time_s", settings_.fixed_delta_time_s);
  archive.field("maximum_delta_time_s", settings_.maximum_delta_time_s);
  archive.field("fixed_step_tolerance_s", settings_.fixed_step_tolerance_s);
  archive.field("time_ns", time_ns_);
  archive.field("delta_ns", delta_ns_);
  archive.field("caller_time_ns", caller_time_ns_);
  archive.field("fixed_step", fixed_step_, {-1e18, 1e18});
  archive.field("frame_count", frame_count_, {0.0, 1e18});
  if (archive.loading()) checkLoaded();
}

void GameClock::checkLoaded() const {
  try {
    settings_.validate();
  } catch (const InvalidArgument& error) {
    throw EngineError(std::string("saved state: ") + error.what());
  }
  for (const std::int64_t time : {time_ns_, delta_ns_, caller_time_ns_}) {
    if (time < 0 || time > kLatest_ns) {
      throw EngineError("saved state: a clock at " + std::to_string(time) + " ns");
    }
  }
  // Between frames every fixed step that was due has been done.
  if (std::abs(fixed_step_ - lastFixedStep()) > 1) {
    throw EngineError("saved state: fixed step " + std::to_string(fixed_step_) + " at " +
                      std::to_string(time_ns_) + " ns");
  }
}

}  // namespace sim2vr

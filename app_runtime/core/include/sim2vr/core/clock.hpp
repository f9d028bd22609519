// SPDX-License-Identifier: Apache-2.0
// The lockstep clock: integer nanoseconds inside, Unity's binary32 seconds outside. It moves only
// when a frame begins, never with the wall clock.
#pragma once

#include <cstdint>

#include "sim2vr/core/archive.hpp"

namespace sim2vr {

struct TimeSettings {
  /// Period of the fixed-step grid (physics), s, used as the nearest binary32, as in Unity. Steps
  /// lie at k * period, in double precision, on the absolute clock.
  double fixed_delta_time_s = 0.002;
  /// A frame longer than this advances game time by this much only, s.
  double maximum_delta_time_s = 1.0 / 3.0;
  /// Game seconds per wall-clock second where frames are paced for people; lockstep ignores it.
  double time_scale = 1.0;
  /// Frames per second that the app aims at, Hz (user steps per second in lockstep).
  int target_frame_rate = 20;
  /// A fixed step belongs to the first frame with k * period <= frame time + tolerance. Zero in our
  /// own clocks; a recording's rounded time stamps need 1e-5 s.
  double fixed_step_tolerance_s = 0.0;

  /// Throws InvalidArgument naming the setting that is not positive and finite, a fixed step below
  /// 10 us, and a longest frame of more than 10^7 fixed steps.
  void validate() const;
};

/// Time of frame `frame` in lockstep at `frame_rate_hz`, ns: n times the largest binary32 below the
/// frame period (20 Hz: n * 0.049999997 s), where the reference's recorded frames lie. A hair below
/// the grid of fixed steps, no game time is a tie that binary32 rounding would decide. Throws
/// InvalidArgument for a negative frame or a rate below 1.
std::int64_t lockstepFrameTimeNs(std::int64_t frame, int frame_rate_hz);

class GameClock {
 public:
  explicit GameClock(const TimeSettings& settings = {});

  const TimeSettings& settings() const { return settings_; }

  /// Puts the clock to `start_ns` with no frame begun; fixed steps at or before it are skipped.
  void restart(std::int64_t start_ns = 0);

  /// Begins the frame at `frame_time_ns` on the caller's clock (same origin as restart's start_ns).
  /// Throws InvalidArgument when it lies before the previous frame.
  void beginFrame(std::int64_t frame_time_ns);

  /// Advances to the next fixed step due in this frame; false when none is left.
  bool beginFixedStep();
  void endFixedStep() { in_fixed_step_ = false; }

  std::int64_t timeNs() const { return time_ns_; }

  // Unity's values, s. Within a fixed step time and deltaTime read fixedTime and fixedDeltaTime.
  float time() const;
  float deltaTime() const;
  float fixedTime() const;
  float fixedDeltaTime() const { return static_cast<float>(settings_.fixed_delta_time_s); }
  float timeScale() const { return static_cast<float>(settings_.time_scale); }

  void fields(Archive& archive);

 private:
  /// The last one at or before the present frame.
  std::int64_t lastFixedStep() const;
  void checkLoaded() const;
  double fixedPeriodNs() const { return static_cast<double>(fixedDeltaTime()) * 1e9; }

  TimeSettings settings_;
  std::int64_t time_ns_ = 0;
  std::int64_t delta_ns_ = 0;
  std::int64_t caller_time_ns_ = 0;
  std::int64_t fixed_step_ = 0;  // k of the latest fixed step
  std::int64_t frame_count_ = 0;
  bool in_fixed_step_ = false;
};

}  // namespace sim2vr

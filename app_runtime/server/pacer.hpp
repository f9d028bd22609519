// Paces frames against the wall clock, for people who watch. Lockstep itself needs none.
#pragma once

#include <chrono>
#include <cstdint>

namespace sim2vr::server {

class Pacer {
 public:
  /// `time_scale`: game seconds per wall-clock second.
  Pacer(bool enabled, double time_scale) : enabled_(enabled), time_scale_(time_scale) {}

  /// The frame at `time_ns` is shown now.
  void restart(std::int64_t time_ns);
  /// Returns when the frame at `time_ns` is due, after a second of wall-clock time at most. A delay
  /// of more than 0.1 s is not caught up.
  void waitFor(std::int64_t time_ns);

 private:
  using Clock = std::chrono::steady_clock;

  bool enabled_;
  double time_scale_;
  std::int64_t shown_ns_ = 0;
  Clock::time_point shown_at_{};
};

}  // namespace sim2vr::server

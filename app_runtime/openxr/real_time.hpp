// SPDX-License-Identifier: Apache-2.0
// Time that a preloaded virtual clock does not touch: the kernel's own, asked past the C library.
#pragma once

#include <cstdint>

namespace sim2vr::openxr {

/// CLOCK_MONOTONIC of the machine.
std::int64_t realNow_ns();
void realSleep(std::int64_t duration_ns);

/// Wakes a thread that waits for it, now or later.
class Bell {
 public:
  Bell();
  ~Bell();
  Bell(const Bell&) = delete;
  Bell& operator=(const Bell&) = delete;
  void ring();
  /// Until it rings, for the duration at most.
  void wait(std::int64_t duration_ns) const;

 private:
  int event_;
};

}  // namespace sim2vr::openxr

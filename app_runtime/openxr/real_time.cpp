// SPDX-License-Identifier: Apache-2.0
#include "real_time.hpp"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <ctime>

namespace sim2vr::openxr {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

struct timespec timespecOf(std::int64_t duration_ns) {
  return {duration_ns / kSecond_ns, duration_ns % kSecond_ns};
}

}  // namespace

std::int64_t realNow_ns() {
  struct timespec now{};
  ::syscall(SYS_clock_gettime, CLOCK_MONOTONIC, &now);
  return now.tv_sec * kSecond_ns + now.tv_nsec;
}

void realSleep(std::int64_t duration_ns) {
  if (duration_ns <= 0) return;
  const struct timespec duration = timespecOf(duration_ns);
  ::syscall(SYS_nanosleep, &duration, nullptr);
}

Bell::Bell() : event_(::eventfd(0, EFD_CLOEXEC)) {}

Bell::~Bell() { ::close(event_); }

void Bell::ring() { ::eventfd_write(event_, 1); }

void Bell::wait(std::int64_t duration_ns) const {
  struct pollfd waited{event_, POLLIN, 0};
  const struct timespec duration = timespecOf(duration_ns);
  ::syscall(SYS_ppoll, &waited, 1, &duration, nullptr, 0);
}

}  // namespace sim2vr::openxr

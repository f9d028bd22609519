#include "real_time.hpp"

#include <linux/futex.h>
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

void realWait(const std::uint32_t* word, std::int64_t duration_ns) {
  const struct timespec duration = timespecOf(duration_ns);
  ::syscall(SYS_futex, word, FUTEX_WAIT_PRIVATE, 0, &duration, nullptr, 0);
}

void realWake(const std::uint32_t* word) {
  ::syscall(SYS_futex, word, FUTEX_WAKE_PRIVATE, 1, nullptr, nullptr, 0);
}

}  // namespace sim2vr::openxr

// Time that a preloaded virtual clock does not touch: the kernel's own, asked past the C library.
#pragma once

#include <cstdint>

namespace sim2vr::openxr {

/// CLOCK_MONOTONIC of the machine.
std::int64_t realNow_ns();
void realSleep(std::int64_t duration_ns);
/// Sleeps until `word` is no longer 0 and it was woken, or for the duration.
void realWait(const std::uint32_t* word, std::int64_t duration_ns);
void realWake(const std::uint32_t* word);

}  // namespace sim2vr::openxr

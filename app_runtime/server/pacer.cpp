#include "pacer.hpp"

#include <algorithm>
#include <thread>

namespace sim2vr::server {

void Pacer::restart(std::int64_t time_ns) {
  shown_ns_ = time_ns;
  shown_at_ = Clock::now();
}

void Pacer::waitFor(std::int64_t time_ns) {
  if (!enabled_) return;
  const double wait_ns = static_cast<double>(time_ns - shown_ns_) / time_scale_;
  const auto wait = std::chrono::nanoseconds(std::int64_t(std::clamp(wait_ns, 0.0, 1e9)));
  const Clock::time_point due = shown_at_ + wait;
  std::this_thread::sleep_until(due);
  shown_ns_ = time_ns;
  shown_at_ = std::max(due, Clock::now() - std::chrono::milliseconds(100));
}

}  // namespace sim2vr::server

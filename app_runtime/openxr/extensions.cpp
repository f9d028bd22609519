// SPDX-License-Identifier: Apache-2.0
#include "extensions.hpp"

#include <ctime>

#include "calls.hpp"
#include "check.hpp"
#include "session_state.hpp"

namespace sim2vr::openxr {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

/// XrTime - CLOCK_MONOTONIC: 0 in real time; in lockstep that of the latest frame.
std::int64_t clockOffset(const Instance& instance) {
  for (const auto& object : world().handles.below(HandleType::session, instance.handle)) {
    return static_cast<const Session&>(*object).monotonic_offset_ns;
  }
  return 0;
}

}  // namespace

const std::vector<Extension>& extensions() {
  static const std::vector<Extension> all = [] {
    std::vector<Extension> list{{"XR_MND_headless", 2},
                                {"XR_KHR_composition_layer_depth", 6},
                                {"XR_KHR_convert_timespec_time", 1},
                                {"XR_KHR_locate_spaces", 1},
                                {"XR_EXT_local_floor", 1},
                                {"XR_EXT_debug_utils", 4}};
    for (const GraphicsMaker& maker : graphicsMakers()) {
      list.push_back({maker.extension, maker.version});
    }
    return list;
  }();
  return all;
}

XrResult XRAPI_CALL calls::xrConvertTimespecTimeToTimeKHR(XrInstance instance,
                                                          const struct timespec* timespecTime,
                                                          XrTime* time) {
  return guarded("xrConvertTimespecTimeToTimeKHR", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    requirePointer(timespecTime, "timespecTime");
    requirePointer(time, "time");
    if (timespecTime->tv_sec < 0 || timespecTime->tv_sec > kSecond_ns ||
        timespecTime->tv_nsec < 0 || timespecTime->tv_nsec >= kSecond_ns) {
      throw Failure(XR_ERROR_TIME_INVALID,
                    fmt::format("timespecTime is {} s and {} ns", timespecTime->tv_sec,
                                timespecTime->tv_nsec));
    }
    const XrTime result =
        timespecTime->tv_sec * kSecond_ns + timespecTime->tv_nsec + clockOffset(*owner);
    requireTime(result, "the time of this moment");
    *time = result;
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrConvertTimeToTimespecTimeKHR(XrInstance instance, XrTime time,
                                                          struct timespec* timespecTime) {
  return guarded("xrConvertTimeToTimespecTimeKHR", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    requirePointer(timespecTime, "timespecTime");
    requireTime(time, "time");
    const std::int64_t monotonic = time - clockOffset(*owner);
    if (monotonic < 0) {
      throw Failure(XR_ERROR_TIME_INVALID, fmt::format("time {} lies before the clock's 0", time));
    }
    *timespecTime = {monotonic / kSecond_ns, monotonic % kSecond_ns};
    return XR_SUCCESS;
  });
}

}  // namespace sim2vr::openxr

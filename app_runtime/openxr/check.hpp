// SPDX-License-Identifier: Apache-2.0
// Checks that many calls share: structures, arrays that are asked for twice, poses, names.
#pragma once

#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <span>
#include <string>
#include <string_view>

#include "api.hpp"

namespace sim2vr::openxr {

[[noreturn]] inline void invalid(const std::string& cause) {
  throw Failure(XR_ERROR_VALIDATION_FAILURE, cause);
}

template <class T>
void requirePointer(const T* pointer, const char* name) {
  if (pointer == nullptr) invalid(fmt::format("{} is null", name));
}

/// A structure of the program, with its type checked.
template <class T>
T& structure(T* pointer, XrStructureType type, const char* name) {
  requirePointer(pointer, name);
  if (pointer->type != type) {
    invalid(fmt::format("{}->type is {}, expected {}", name, static_cast<int>(pointer->type),
                        static_cast<int>(type)));
  }
  return *pointer;
}

/// A structure that may be left out.
template <class T>
void optionalStructure(T* pointer, XrStructureType type, const char* name) {
  if (pointer != nullptr) structure(pointer, type, name);
}

/// The structure of this type in a chain; nullptr: none.
template <class T>
T* chained(const void* next, XrStructureType type) {
  for (int i = 0; next != nullptr && i < 64; ++i) {
    const auto* base = static_cast<const XrBaseInStructure*>(next);
    if (base->type == type) return static_cast<T*>(const_cast<void*>(next));
    next = base->next;
  }
  return nullptr;
}

/// First half of the two-call idiom: stores the count; whether there is something to fill in.
inline bool wantsItems(std::size_t available, std::uint32_t capacity, std::uint32_t* count,
                       const void* items, const char* name) {
  requirePointer(count, "the count");
  *count = static_cast<std::uint32_t>(available);
  if (capacity == 0) return false;
  if (capacity < available) {
    throw Failure(XR_ERROR_SIZE_INSUFFICIENT,
                  fmt::format("{}: room for {}, expected {}", name, capacity, available));
  }
  if (available > 0) requirePointer(items, name);
  return available > 0;
}

template <class T>
XrResult fillItems(std::span<const T> values, std::uint32_t capacity, std::uint32_t* count,
                   T* items, const char* name) {
  if (wantsItems(values.size(), capacity, count, items, name)) {
    std::memcpy(items, values.data(), values.size_bytes());
  }
  return XR_SUCCESS;
}

inline XrResult fillText(std::string_view text, std::uint32_t capacity, std::uint32_t* count,
                         char* buffer) {
  if (wantsItems(text.size() + 1, capacity, count, buffer, "buffer")) {
    std::memcpy(buffer, text.data(), text.size());
    buffer[text.size()] = '\0';
  }
  return XR_SUCCESS;
}

/// Of the program's arrays of structures: each one's type.
template <class T>
void requireTypes(const T* items, std::size_t count, XrStructureType type, const char* name) {
  for (std::size_t i = 0; i < count; ++i) {
    if (items[i].type == type) continue;
    invalid(fmt::format("{}[{}].type is {}, expected {}", name, i, static_cast<int>(items[i].type),
                        static_cast<int>(type)));
  }
}

template <std::size_t N>
void copyText(char (&to)[N], std::string_view text) {
  const std::size_t length = std::min(text.size(), N - 1);
  std::memcpy(to, text.data(), length);
  to[length] = '\0';
}

/// A fixed-size string of the program; it has to end inside its array.
template <std::size_t N>
std::string_view boundedText(const char (&text)[N], const char* name) {
  const void* end = std::memchr(text, 0, N);
  if (end == nullptr) invalid(fmt::format("{} does not end within {} characters", name, N));
  return {text, static_cast<std::size_t>(static_cast<const char*>(end) - text)};
}

inline void requireTime(XrTime time, const char* name) {
  if (time <= 0) {
    throw Failure(XR_ERROR_TIME_INVALID, fmt::format("{} is {}, expected above 0", name, time));
  }
}

inline void requirePose(const XrPosef& pose, const std::string& name) {
  const XrQuaternionf& q = pose.orientation;
  const double length = std::sqrt(static_cast<double>(q.x) * q.x + static_cast<double>(q.y) * q.y +
                                  static_cast<double>(q.z) * q.z + static_cast<double>(q.w) * q.w);
  const XrVector3f& p = pose.position;
  const bool finite = std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
  if (!finite || !(std::abs(length - 1.0) <= 0.01)) {
    throw Failure(XR_ERROR_POSE_INVALID,
                  fmt::format("{} has position {} {} {} and a rotation of length {}, expected "
                              "finite numbers and 1 +- 0.01",
                              name, p.x, p.y, p.z, length));
  }
}

}  // namespace sim2vr::openxr

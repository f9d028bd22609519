// SPDX-License-Identifier: Apache-2.0
// Numbers in binary messages: little-endian, one after the other.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

namespace sim2vr::wire {

/// A received message that is not what its protocol says: the only error that decoders throw. The
/// text names the field, what was got and what was expected.
class MalformedMessage : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

template <class T>
T littleEndian(T value) {
  if constexpr (std::endian::native == std::endian::little) return value;
  auto bytes = std::bit_cast<std::array<std::uint8_t, sizeof(T)>>(value);
  for (std::size_t i = 0; i < sizeof(T) / 2; ++i) std::swap(bytes[i], bytes[sizeof(T) - 1 - i]);
  return std::bit_cast<T>(bytes);
}

/// Reads numbers from a frame.
class Reader {
 public:
  explicit Reader(std::string_view bytes) : bytes_(bytes) {}

  /// Throws MalformedMessage at the end of the frame.
  template <class T>
  T take() {
    if (bytes_.size() < sizeof(T)) throw MalformedMessage("message: a frame ends too early");
    T value;
    std::memcpy(&value, bytes_.data(), sizeof(T));
    bytes_.remove_prefix(sizeof(T));
    return littleEndian(value);
  }
  template <std::size_t N>
  void take(std::array<double, N>& row) {
    for (double& value : row) value = take<double>();
  }
  void skip(std::size_t bytes) { bytes_.remove_prefix(std::min(bytes, bytes_.size())); }

 private:
  std::string_view bytes_;
};

template <class T>
void append(std::string& bytes, T value) {
  const T ordered = littleEndian(value);
  bytes.append(reinterpret_cast<const char*>(&ordered), sizeof(T));
}

}  // namespace sim2vr::wire

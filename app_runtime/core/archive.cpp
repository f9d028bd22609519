// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/archive.hpp"

#include <fmt/format.h>

#include <bit>

#include "sim2vr/core/errors.hpp"

namespace sim2vr {

Archive Archive::loader(std::string bytes) {
  Archive archive;
  archive.loading_ = true;
  archive.bytes_ = std::move(bytes);
  return archive;
}

std::uint64_t Archive::hash() const {
  std::uint64_t value = 14695981039346656037ULL;
  for (const char c : bytes_) {
    value ^= static_cast<unsigned char>(c);
    value *= 1099511628211ULL;
  }
  return value;
}

void Archive::expectEnd() const {
  if (loading_ && offset_ != bytes_.size()) {
    throw EngineError("saved state: " + std::to_string(bytes_.size() - offset_) +
                      " bytes left over; it was made by another game or version");
  }
}

void Archive::byteOrder() {
  constexpr std::uint32_t kOurs = 0x01020304;
  std::uint32_t order = kOurs;
  field("byte_order", order);
  if (order != kOurs) {
    throw EngineError("saved state: made on a machine with another byte order, expected " +
                      std::string(std::endian::native == std::endian::little ? "little" : "big") +
                      " endian");
  }
}

void Archive::tag(std::string_view name) {
  const auto size = static_cast<unsigned char>(name.size());
  if (!loading_) {
    bytes_.push_back(static_cast<char>(size));
    bytes_.append(name);
    return;
  }
  const bool matches = offset_ + 1 + name.size() <= bytes_.size() &&
                       static_cast<unsigned char>(bytes_[offset_]) == size &&
                       std::string_view(bytes_).substr(offset_ + 1, name.size()) == name;
  if (!matches) {
    throw EngineError("saved state: expected the field '" + std::string(name) + "' at byte " +
                      std::to_string(offset_) +
                      "; it is damaged or was made by another game or version");
  }
  offset_ += 1 + name.size();
}

void Archive::expectIn(Range range, std::string_view name, double value) {
  if (value >= range.low && value <= range.high) return;
  throw EngineError(fmt::format("saved state: field '{}': got {}, expected {} to {}", name, value,
                                range.low, range.high));
}

void Archive::raw(void* data, std::size_t size) {
  if (size == 0) return;
  if (!loading_) {
    bytes_.append(static_cast<const char*>(data), size);
    return;
  }
  if (size > bytes_.size() - offset_) {
    throw EngineError("saved state: truncated at byte " + std::to_string(offset_));
  }
  std::memcpy(data, bytes_.data() + offset_, size);
  offset_ += size;
}

void Archive::transfer(bool& value) {
  unsigned char byte = value ? 1 : 0;
  raw(&byte, 1);
  if (byte > 1) {
    throw EngineError("saved state: got " + std::to_string(byte) + " at byte " +
                      std::to_string(offset_ - 1) + ", expected true or false");
  }
  value = byte == 1;
}

std::uint64_t Archive::count(std::size_t size) {
  std::uint64_t value = size;
  raw(&value, sizeof(value));
  // A damaged count must not ask for more memory than the bytes could ever fill.
  if (loading_ && value > bytes_.size() - offset_) {
    throw EngineError("saved state: count " + std::to_string(value) + " exceeds the bytes left");
  }
  return value;
}

}  // namespace sim2vr

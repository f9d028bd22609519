// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/server/base64.hpp"

#include <array>
#include <cstdint>

#include "sim2vr/server/message.hpp"

namespace sim2vr::server {
namespace {

constexpr std::string_view kDigits =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
constexpr std::uint8_t kNoDigit = 64;

constexpr std::array<std::uint8_t, 256> digitValues() {
  std::array<std::uint8_t, 256> values{};
  values.fill(kNoDigit);
  for (std::size_t i = 0; i < kDigits.size(); ++i) {
    values[static_cast<unsigned char>(kDigits[i])] = static_cast<std::uint8_t>(i);
  }
  return values;
}

constexpr std::array<std::uint8_t, 256> kValues = digitValues();

std::uint32_t digit(char c) {
  const std::uint8_t value = kValues[static_cast<unsigned char>(c)];
  if (value == kNoDigit) throw MalformedMessage("base64: got a character outside its alphabet");
  return value;
}

std::uint32_t byteAt(std::string_view bytes, std::size_t i) {
  return i < bytes.size() ? static_cast<unsigned char>(bytes[i]) : 0U;
}

}  // namespace

std::string encodeBase64(std::string_view bytes) {
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::uint32_t bits =
        byteAt(bytes, i) << 16 | byteAt(bytes, i + 1) << 8 | byteAt(bytes, i + 2);
    text += kDigits[bits >> 18 & 63];
    text += kDigits[bits >> 12 & 63];
    text += i + 1 < bytes.size() ? kDigits[bits >> 6 & 63] : '=';
    text += i + 2 < bytes.size() ? kDigits[bits & 63] : '=';
  }
  return text;
}

std::string decodeBase64(std::string_view text) {
  if (text.size() % 4 != 0) {
    throw MalformedMessage("base64: got " + std::to_string(text.size()) +
                           " characters, expected a multiple of 4");
  }
  const std::size_t padding = text.ends_with("==") ? 2 : text.ends_with('=') ? 1 : 0;
  std::string bytes;
  bytes.reserve(text.size() / 4 * 3);
  for (std::size_t i = 0; i < text.size(); i += 4) {
    const std::size_t digits = i + 4 == text.size() ? 4 - padding : 4;
    std::uint32_t bits = 0;
    for (std::size_t d = 0; d < 4; ++d) bits = bits << 6 | (d < digits ? digit(text[i + d]) : 0U);
    bytes += static_cast<char>(bits >> 16 & 255);
    if (digits > 2) bytes += static_cast<char>(bits >> 8 & 255);
    if (digits > 3) bytes += static_cast<char>(bits & 255);
    const std::uint32_t unused = digits == 2 ? 0xFFFFU : digits == 3 ? 0xFFU : 0U;
    if ((bits & unused) != 0) throw MalformedMessage("base64: got bits after the last byte");
  }
  return bytes;
}

}  // namespace sim2vr::server

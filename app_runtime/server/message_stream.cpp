#include "sim2vr/server/message_stream.hpp"

namespace sim2vr::server {
namespace {

constexpr std::size_t kNumberBytes = 4;

std::uint32_t numberAt(std::string_view bytes, std::size_t offset) {
  std::uint32_t number = 0;
  for (std::size_t i = 0; i < kNumberBytes; ++i) {
    number |= static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[offset + i])) << (8 * i);
  }
  return number;
}

void append(std::string& bytes, std::size_t number) {
  for (std::size_t i = 0; i < kNumberBytes; ++i) {
    bytes += static_cast<char>((number >> (8 * i)) & 0xFFU);
  }
}

}  // namespace

std::uint32_t MessageStream::count() const {
  return bytes_.size() < kNumberBytes ? 0 : numberAt(bytes_, 0);
}

std::uint64_t MessageStream::total() const {
  const std::uint32_t frames = count();
  std::uint64_t bytes = kNumberBytes * (1 + std::uint64_t{frames});
  if (frames == 0 || frames > kMaximumParts || bytes_.size() < bytes) return 0;
  for (std::uint32_t i = 1; i <= frames; ++i) bytes += numberAt(bytes_, kNumberBytes * i);
  return bytes;
}

bool MessageStream::complete() const {
  if (bytes_.size() < kNumberBytes) return false;
  if (count() == 0 || count() > kMaximumParts) return true;
  return total() != 0 && (total() > kMaximumBytes || bytes_.size() >= total());
}

std::optional<std::vector<std::string>> MessageStream::take() {
  if (!complete()) return std::nullopt;
  const std::uint32_t frames = count();
  if (frames == 0 || frames > kMaximumParts) {
    throw MalformedMessage("stream: got " + std::to_string(frames) + " frames, expected 1 to " +
                           std::to_string(kMaximumParts));
  }
  if (total() > kMaximumBytes) {
    throw MalformedMessage("stream: got a message of " + std::to_string(total()) +
                           " bytes, expected " + std::to_string(kMaximumBytes) + " at most");
  }
  std::vector<std::string> message;
  std::size_t end = kNumberBytes * (1 + frames);
  for (std::uint32_t i = 1; i <= frames; ++i) {
    const std::size_t size = numberAt(bytes_, kNumberBytes * i);
    message.push_back(bytes_.substr(end, size));
    end += size;
  }
  bytes_.erase(0, end);
  return message;
}

std::string streamHeader(const Reply& frames) {
  std::string header;
  append(header, frames.size());
  for (const std::string& frame : frames) append(header, frame.size());
  return header;
}

}  // namespace sim2vr::server

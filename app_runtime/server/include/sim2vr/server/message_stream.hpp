// Messages in a stream of bytes, for sockets that know no messages: u32 number of frames, u32 size
// of each, then the frames; little-endian.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/server/message.hpp"

namespace sim2vr::server {

/// Takes messages out of a stream, however it was cut into pieces.
class MessageStream {
 public:
  /// As many frames as any message has, and some more: those the decoders refuse.
  static constexpr std::uint32_t kMaximumParts = 16;
  static constexpr std::uint64_t kMaximumBytes = std::uint64_t{64} << 20;

  void feed(std::string_view bytes) { bytes_.append(bytes); }

  /// The next message; none while it is not complete. Throws MalformedMessage when what comes is
  /// none, or is longer than kMaximumBytes: the stream cannot be read any further then.
  std::optional<std::vector<std::string>> take();
  /// Whether take() has something to say.
  bool complete() const;

 private:
  /// Frames of the next message, 0 while it is not known.
  std::uint32_t count() const;
  /// Bytes of the next message, 0 while they are not known.
  std::uint64_t total() const;

  std::string bytes_;
};

/// What goes before the frames.
std::string streamHeader(const Reply& frames);

}  // namespace sim2vr::server

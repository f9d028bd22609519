// SPDX-License-Identifier: Apache-2.0
#include "channel.hpp"

#include <fmt/format.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <cstring>

namespace sim2vr::openxr {

void Channel::send(MessageKind kind, std::string_view body, int file) {
  if (body.size() + 1 > kMaximumMessageBytes) {
    throw wire::MalformedMessage(
        fmt::format("message to the harness: got {} bytes, expected up to {}", body.size() + 1,
                    kMaximumMessageBytes));
  }
  std::string bytes;
  wire::append(bytes, static_cast<std::uint32_t>(body.size() + 1));
  wire::append(bytes, static_cast<std::uint8_t>(kind));
  bytes += body;
  const std::lock_guard lock(sending_);
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof file)> control{};
  for (std::size_t sent = 0; sent < bytes.size();) {
    iovec rest{bytes.data() + sent, bytes.size() - sent};
    msghdr message{};
    message.msg_iov = &rest;
    message.msg_iovlen = 1;
    if (file >= 0 && sent == 0) {
      message.msg_control = control.data();
      message.msg_controllen = control.size();
      cmsghdr* rights = CMSG_FIRSTHDR(&message);
      rights->cmsg_level = SOL_SOCKET;
      rights->cmsg_type = SCM_RIGHTS;
      rights->cmsg_len = CMSG_LEN(sizeof file);
      std::memcpy(CMSG_DATA(rights), &file, sizeof file);
    }
    const ssize_t n = ::sendmsg(socket_, &message, MSG_NOSIGNAL);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw ChannelClosed(fmt::format("the harness is gone ({})", std::strerror(errno)));
    sent += static_cast<std::size_t>(n);
  }
}

void Channel::read(char* to, std::size_t bytes) {
  while (bytes > 0) {
    const ssize_t n = ::recv(socket_, to, bytes, 0);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno == EAGAIN) {
      throw ChannelClosed(
          fmt::format("the harness gave no answer within {:g} s, expected one to every hello and "
                      "session; see where it hangs, and start the program again",
                      limit_s_));
    }
    if (n < 0) throw ChannelClosed(fmt::format("the harness is gone ({})", std::strerror(errno)));
    if (n == 0) throw ChannelClosed("the harness is gone (it closed the socket)");
    to += n;
    bytes -= static_cast<std::size_t>(n);
  }
}

Message Channel::receive() {
  std::array<char, 5> head{};
  read(head.data(), head.size());
  wire::Reader reader(std::string_view(head.data(), head.size()));
  const auto length = reader.take<std::uint32_t>();
  const auto kind = reader.take<std::uint8_t>();
  if (length < 1 || length > kMaximumMessageBytes) {
    throw wire::MalformedMessage(fmt::format("message.length: got {} bytes, expected 1 to {}",
                                             length, kMaximumMessageBytes));
  }
  if (kind < 1 || kind > static_cast<std::uint8_t>(MessageKind::error)) {
    throw wire::MalformedMessage(fmt::format("message.kind: got {}, expected 1 to 9", kind));
  }
  Message message{static_cast<MessageKind>(kind), std::string(length - 1, '\0')};
  read(message.body.data(), message.body.size());
  return message;
}

void Channel::limit(double seconds) {
  limit_s_ = seconds;
  // The kernel's own time-out: poll() would wait for virtual time.
  const auto us = static_cast<std::int64_t>(seconds * 1e6);
  const timeval time{us / 1'000'000, us % 1'000'000};
  ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &time, sizeof time);
}

void Channel::shutdown() { ::shutdown(socket_, SHUT_RDWR); }

}  // namespace sim2vr::openxr

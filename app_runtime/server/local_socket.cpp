#include "local_socket.hpp"

#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstring>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"

namespace sim2vr::server {
namespace {

constexpr int kWaitingConnections = 8;
constexpr std::size_t kReadBytes = std::size_t{1} << 16;
/// A client that takes nothing for so long has lost interest.
constexpr int kPatience_ms = 10'000;

[[noreturn]] void refuse(const std::string& name, const std::string& problem) {
  throw InvalidArgument("local-socket", "'" + name + "' (" + problem + ")",
                        "the path of a file that does not exist yet, or @ and a name that is free");
}

/// The address, and its length in bytes.
std::pair<sockaddr_un, socklen_t> addressOf(const std::string& name) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const bool has_file = name[0] != '@';
  if (name.size() < 2 || name.size() + 1 > sizeof(address.sun_path)) {
    refuse(name, "too short or too long");
  }
  std::memcpy(address.sun_path, name.data(), name.size());
  if (!has_file) address.sun_path[0] = '\0';
  const std::size_t length = offsetof(sockaddr_un, sun_path) + name.size() + (has_file ? 1 : 0);
  return {address, static_cast<socklen_t>(length)};
}

}  // namespace

LocalSocket::LocalSocket(const std::string& name) {
  if (name.empty()) refuse(name, "empty");
  const auto [address, length] = addressOf(name);
  listener_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (listener_ < 0) throw EngineError(std::string("local socket: ") + std::strerror(errno));
  const auto* bound = reinterpret_cast<const sockaddr*>(&address);
  if (::bind(listener_, bound, length) != 0 || ::listen(listener_, kWaitingConnections) != 0) {
    const int problem = errno;
    ::close(listener_);
    refuse(name, std::strerror(problem));
  }
  if (name[0] != '@') {
    file_ = name;
    ::chmod(file_.c_str(), S_IRUSR | S_IWUSR);
  }
}

LocalSocket::~LocalSocket() {
  for (const auto& entry : connections_) ::close(entry.first);
  ::close(listener_);
  if (!file_.empty()) ::unlink(file_.c_str());
}

std::vector<int> LocalSocket::descriptors() const {
  std::vector<int> found{listener_};
  for (const auto& entry : connections_) found.push_back(entry.first);
  return found;
}

bool LocalSocket::waiting() const {
  return std::any_of(connections_.begin(), connections_.end(),
                     [](const auto& entry) { return entry.second.stream.complete(); });
}

void LocalSocket::accept() {
  while (true) {
    const int descriptor = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (descriptor < 0) return;
    connections_[descriptor].client = "local " + std::to_string(accepted_++);
  }
}

bool LocalSocket::read(int descriptor, Connection& connection) {
  // What is left over shows at the next poll.
  std::array<char, kReadBytes> bytes;
  const ssize_t count = ::recv(descriptor, bytes.data(), bytes.size(), 0);
  if (count == 0) return false;
  if (count < 0) return errno == EAGAIN || errno == EINTR;
  connection.stream.feed({bytes.data(), static_cast<std::size_t>(count)});
  return true;
}

std::optional<LocalSocket::Arrival> LocalSocket::receive(std::vector<int>& closed) {
  accept();
  for (auto entry = connections_.begin(); entry != connections_.end();) {
    auto& [descriptor, connection] = *entry;
    bool open = true;
    std::optional<std::vector<std::string>> frames;
    try {
      frames = connection.stream.take();
      if (!frames) {
        open = read(descriptor, connection);
        frames = connection.stream.take();
      }
    } catch (const MalformedMessage& error) {
      logger().warn("a client on the local socket is cut off: {}", error.what());
      open = false;
    }
    if (frames) return Arrival{descriptor, connection.client, *std::move(frames)};
    if (open) {
      ++entry;
    } else {
      ::close(descriptor);
      closed.push_back(descriptor);
      entry = connections_.erase(entry);
    }
  }
  return std::nullopt;
}

void LocalSocket::send(int connection, const Reply& reply) {
  std::string header = streamHeader(reply);
  std::vector<iovec> parts{{header.data(), header.size()}};
  for (const std::string& frame : reply) {
    parts.push_back({const_cast<char*>(frame.data()), frame.size()});
  }
  std::size_t first = 0;
  while (first < parts.size()) {
    msghdr message{};
    message.msg_iov = &parts[first];
    message.msg_iovlen = parts.size() - first;
    ssize_t sent = ::sendmsg(connection, &message, MSG_NOSIGNAL);
    if (sent < 0 && (errno == EAGAIN || errno == EINTR)) {
      pollfd writable{connection, POLLOUT, 0};
      sent = ::poll(&writable, 1, kPatience_ms) > 0 ? 0 : -1;
    }
    if (sent < 0) {
      // Shows as the end of the connection in the next receive.
      ::shutdown(connection, SHUT_RDWR);
      return;
    }
    auto left = static_cast<std::size_t>(sent);
    while (first < parts.size() && left >= parts[first].iov_len) left -= parts[first++].iov_len;
    if (first < parts.size()) {
      parts[first].iov_base = static_cast<char*>(parts[first].iov_base) + left;
      parts[first].iov_len -= left;
    }
  }
}

}  // namespace sim2vr::server

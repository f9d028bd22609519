// The server over a Unix socket, beside ZeroMQ.
#include "local_socket.hpp"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstring>
#include <filesystem>
#include <future>
#include <memory>

#include "players.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/server/server.hpp"

namespace sim2vr::server {
namespace {

using protocol2::Status;
using protocol2::Type;
using testing::Json;
using testing::message2;
using testing::playerPoses;

constexpr int kDeadline_s = 20;

/// A name that nobody else uses.
std::string freeName() {
  static int number = 0;
  return "@sim2vr-test-" + std::to_string(::getpid()) + "-" + std::to_string(number++);
}

class LocalServer {
 public:
  explicit LocalServer(bool keep = false, const std::string& name = freeName()) : name_(name) {
    ServerSettings values;
    values.port = 0;
    values.keep = keep;
    values.local_socket = name;
    values.host.app = testing::appSettings();
    values.host.renderer = "null";
    server_ = std::make_unique<Server>(values);
    ending_ = std::async(std::launch::async, [this] { return server_->run(stop_); });
  }
  ~LocalServer() { stop_.raise(); }

  const std::string& name() const { return name_; }
  void stop() { stop_.raise(); }
  Ending ending() {
    EXPECT_EQ(ending_.wait_for(std::chrono::seconds(kDeadline_s)), std::future_status::ready);
    return ending_.get();
  }

 private:
  std::string name_;
  StopRequest stop_;
  std::unique_ptr<Server> server_;
  std::future<Ending> ending_;
};

class LocalClient {
 public:
  explicit LocalClient(const std::string& name)
      : descriptor_(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, name.data(), name.size());
    const bool has_file = name[0] != '@';
    if (!has_file) address.sun_path[0] = '\0';
    const auto length = offsetof(sockaddr_un, sun_path) + name.size() + (has_file ? 1 : 0);
    if (::connect(descriptor_, reinterpret_cast<sockaddr*>(&address),
                  static_cast<socklen_t>(length)) != 0) {
      throw std::runtime_error(std::strerror(errno));
    }
    const timeval deadline{kDeadline_s, 0};
    ::setsockopt(descriptor_, SOL_SOCKET, SO_RCVTIMEO, &deadline, sizeof(deadline));
  }
  ~LocalClient() { ::close(descriptor_); }
  LocalClient(const LocalClient&) = delete;
  LocalClient& operator=(const LocalClient&) = delete;

  void sendBytes(const std::string& bytes) const {
    std::size_t done = 0;
    while (done < bytes.size()) {
      const ssize_t sent =
          ::send(descriptor_, bytes.data() + done, bytes.size() - done, MSG_NOSIGNAL);
      if (sent < 0) return;
      done += static_cast<std::size_t>(sent);
    }
  }
  void send(const Reply& frames) const {
    std::string bytes = streamHeader(frames);
    for (const std::string& frame : frames) bytes += frame;
    sendBytes(bytes);
  }
  /// Empty when the server has closed the connection.
  Reply receive() {
    while (true) {
      if (auto frames = stream_.take()) return *frames;
      char bytes[4096];
      const ssize_t count = ::recv(descriptor_, bytes, sizeof(bytes), 0);
      if (count < 0) throw std::runtime_error("no reply within the deadline");
      if (count == 0) return {};
      stream_.feed({bytes, static_cast<std::size_t>(count)});
    }
  }
  Reply ask(const Reply& frames) {
    send(frames);
    return receive();
  }
  Status ask2(Type type, std::uint32_t count = 0, const std::vector<std::string>& frames = {}) {
    return static_cast<Status>(
        protocol2::decodeHeader(ask(message2(type, count, frames)).at(0)).status);
  }

 private:
  int descriptor_;
  MessageStream stream_;
};

TEST(LocalSocket, BothProtocolsAreSpoken) {
  LocalServer server(true);
  {
    LocalClient client(server.name());
    EXPECT_EQ(client.ask2(Type::hello, 0, {"{}"}), Status::ok);
    EXPECT_EQ(client.ask2(Type::reset, 1, {testing::resetRecord(0, 1, 0, playerPoses(0)), ""}),
              Status::ok);
    EXPECT_EQ(client.ask2(Type::quit), Status::ok);
  }
  {
    LocalClient client(server.name());
    const Reply reply = client.ask({testing::handshakeJson().dump()});
    EXPECT_EQ(Json::parse(reply.at(0))["timeFeature"], -1.0);
    client.ask({R"({"quitApplication": true})"});
  }
  server.stop();
  EXPECT_EQ(server.ending(), Ending::stopped);
}

TEST(LocalSocket, SeveralMessagesAtOnceAndOneInPieces) {
  LocalServer server;
  LocalClient client(server.name());
  EXPECT_EQ(client.ask2(Type::hello, 0, {"{}"}), Status::ok);
  EXPECT_EQ(client.ask2(Type::reset, 1, {testing::resetRecord(0, 1, 0, playerPoses(0)), ""}),
            Status::ok);
  std::string bytes;
  for (int i = 0; i < 3; ++i) {
    const Reply message = message2(Type::hash, 0, {testing::appIndex(0)});
    bytes += streamHeader(message);
    for (const std::string& frame : message) bytes += frame;
  }
  client.sendBytes(bytes);
  const Reply first = client.receive();
  EXPECT_EQ(client.receive(), first);
  EXPECT_EQ(client.receive(), first);
  for (const char byte : bytes) client.sendBytes(std::string(1, byte));
  for (int i = 0; i < 3; ++i) EXPECT_EQ(client.receive(), first);
  // More than fits into the socket's buffers, there and back.
  const std::string large(8 << 20, ' ');
  const Reply refused = client.ask(message2(Type::load, 0, {testing::appIndex(0), large}));
  EXPECT_EQ(static_cast<Status>(protocol2::decodeHeader(refused[0]).status), Status::engine_error);
  EXPECT_EQ(client.ask2(Type::reset, 1, {testing::resetRecord(0, 1, 0, playerPoses(0)), ""}),
            Status::ok);
  const Reply picture = client.ask(message2(
      Type::render, 0, {R"({"app": 0, "view": "headset", "width": 1024, "height": 1024})"}));
  EXPECT_EQ(picture.at(1).size(), std::size_t{4} << 20);
  EXPECT_EQ(client.ask2(Type::quit), Status::ok);
  EXPECT_EQ(server.ending(), Ending::quit);
}

TEST(LocalSocket, ASecondClientIsToldSoAndAVanishedOneEndsTheSession) {
  LocalServer server;
  {
    LocalClient owner(server.name());
    EXPECT_EQ(owner.ask2(Type::hello, 0, {"{}"}), Status::ok);
    {
      LocalClient second(server.name());
      EXPECT_EQ(second.ask2(Type::hello, 0, {"{}"}), Status::busy);
    }
    EXPECT_EQ(owner.ask2(Type::reset, 1, {testing::resetRecord(0, 1, 0, playerPoses(0)), ""}),
              Status::ok);
  }
  EXPECT_EQ(server.ending(), Ending::client_vanished);
}

TEST(LocalSocket, WhatIsNoMessageCostsTheConnectionOnly) {
  LocalServer server;
  LocalClient owner(server.name());
  EXPECT_EQ(owner.ask2(Type::hello, 0, {"{}"}), Status::ok);
  LocalClient other(server.name());
  other.sendBytes(std::string(4, '\0'));
  EXPECT_TRUE(other.receive().empty());
  EXPECT_EQ(owner.ask2(Type::quit), Status::ok);
  EXPECT_EQ(server.ending(), Ending::quit);
}

TEST(LocalSocket, AFileIsMadeForItsOwnerOnlyAndTakenAway) {
  const auto path = std::filesystem::path(::testing::TempDir()) / "sim2vr_local_socket_test";
  std::filesystem::remove(path);
  {
    LocalServer server(false, path.string());
    const auto permissions = std::filesystem::status(path).permissions();
    EXPECT_EQ(permissions & std::filesystem::perms::all,
              std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
    LocalClient client(path.string());
    EXPECT_EQ(client.ask2(Type::hello, 0, {"{}"}), Status::ok);
    EXPECT_EQ(client.ask2(Type::quit), Status::ok);
    EXPECT_EQ(server.ending(), Ending::quit);
  }
  EXPECT_FALSE(std::filesystem::exists(path));
}

TEST(LocalSocket, NamesThatCannotBeUsed) {
  const std::string taken = freeName();
  const LocalSocket first(taken);
  for (const std::string& name :
       {taken, std::string("@"), std::string(200, 'x'), std::string("/no/such/folder/socket")}) {
    try {
      const LocalSocket second(name);
      FAIL() << name;
    } catch (const InvalidArgument& error) {
      EXPECT_EQ(error.field(), "local-socket");
    }
  }
}

}  // namespace
}  // namespace sim2vr::server

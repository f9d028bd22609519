// SPDX-License-Identifier: Apache-2.0
// The server over real sockets.
#include "sim2vr/server/server.hpp"
#include "own_folder.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <future>
#include <memory>
#include <thread>
#include <zmq.hpp>

#include "players.hpp"
#include "png_image.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::server {
namespace {

using protocol2::Type;
using testing::frameNs;
using testing::handshakeJson;
using testing::Json;
using testing::message2;
using testing::playerPoses;
using testing::stateJson;

/// No test waits longer for a reply.
constexpr int kDeadline_ms = 20'000;

ServerSettings settings(const std::string& renderer = "null") {
  ServerSettings values;
  values.port = 0;
  values.host.app = testing::appSettings();
  values.host.renderer = renderer;
  return values;
}

/// A server that runs in a thread.
class Running {
 public:
  explicit Running(const ServerSettings& values)
      : server_(std::make_unique<Server>(values)),
        ending_(std::async(std::launch::async,
                           [this] {
                             const Ending ending = server_->run(stop_);
                             server_.reset();
                             return ending;
                           })),
        endpoint(server_endpoint_) {}
  ~Running() { stop_.raise(); }

  Ending ending() {
    EXPECT_EQ(ending_.wait_for(std::chrono::milliseconds(kDeadline_ms)), std::future_status::ready);
    return ending_.get();
  }
  void stop() { stop_.raise(); }

 private:
  StopRequest stop_;
  std::unique_ptr<Server> server_;
  std::string server_endpoint_ = server_->endpoint();
  std::future<Ending> ending_;

 public:
  const std::string endpoint;
};

class Client {
 public:
  explicit Client(const std::string& endpoint, zmq::socket_type type = zmq::socket_type::req)
      : socket_(context_, type) {
    socket_.set(zmq::sockopt::linger, 0);
    socket_.set(zmq::sockopt::rcvtimeo, kDeadline_ms);
    socket_.connect(endpoint);
  }

  void send(const Reply& frames) {
    for (std::size_t i = 0; i < frames.size(); ++i) {
      socket_.send(zmq::buffer(frames[i]),
                   i + 1 < frames.size() ? zmq::send_flags::sndmore : zmq::send_flags::none);
    }
  }
  Reply receive() {
    Reply frames;
    zmq::message_t part;
    do {
      if (!socket_.recv(part)) throw std::runtime_error("no reply within the deadline");
      frames.push_back(part.to_string());
    } while (part.more());
    return frames;
  }
  Reply ask(const Reply& frames) {
    send(frames);
    return receive();
  }
  Json ask1(const Json& message) { return Json::parse(ask({message.dump()}).at(0)); }
  Reply ask2(Type type, std::uint32_t count = 0, const std::vector<std::string>& frames = {}) {
    return ask(message2(type, count, frames));
  }
  void quit() { ask2(Type::quit); }

 private:
  zmq::context_t context_;
  zmq::socket_t socket_;
};

testing::Played playProtocol1(const std::string& endpoint, int frames, std::uint32_t seed) {
  Client client(endpoint);
  Json handshake = handshakeJson();
  handshake["frameTime"] = "current";
  handshake["clock"] = "round";
  handshake["headRotation"] = "device";
  client.ask1(handshake);
  testing::Played played;
  for (int n = 0; n <= frames; ++n) {
    Json state = stateJson(playerPoses(n), 0.05 * n, n == 0);
    if (n == 0) state["seed"] = seed;
    if (n == frames) state["stateHash"] = true;
    const Json reply = client.ask1(state);
    played.add(static_cast<float>(reply["reward"].get<double>()), reply["isFinished"],
               static_cast<float>(reply["timeFeature"].get<double>()),
               Json::parse(reply["logDict"].get<std::string>()),
               testing::decodePng(reply["image"]).rgba);
    if (n == frames) {
      played.state_hash = std::stoull(reply["stateHash"].get<std::string>(), nullptr, 16);
    }
  }
  client.ask1({{"quitApplication", true}});
  return played;
}

/// A client's memory of log names.
using Names = std::map<std::string, std::vector<std::string>>;

void addResult(const Reply& reply, Names& names, testing::Played& played) {
  if (!reply.at(3).empty()) names.merge(Json::parse(reply.at(3))["logs"].get<Names>());
  const std::string& record = reply.at(1);
  std::map<std::string, double> log;
  const auto& own = names.at(std::to_string(testing::read<std::uint32_t>(record, 24)));
  ASSERT_EQ(testing::read<std::uint32_t>(record, 20), own.size());
  for (std::size_t i = 0; i < own.size(); ++i)
    log[own[i]] = testing::read<double>(reply.at(2), 8 * i);
  played.add(testing::read<float>(record, 8), testing::read<std::uint32_t>(record, 4) == 1,
             testing::read<float>(record, 12), log, {reply.at(4).begin(), reply.at(4).end()});
}

testing::Played playProtocol2(const std::string& endpoint, int frames, std::uint32_t seed) {
  Client client(endpoint);
  client.ask2(Type::hello, 0, {"{}"});
  testing::Played played;
  Names names;
  addResult(client.ask2(Type::reset, 1, {testing::resetRecord(0, seed, 0, playerPoses(0)), ""}),
            names, played);
  for (int n = 1; n <= frames; ++n) {
    addResult(
        client.ask2(Type::step, 1,
                    {testing::stepRecord(0, 1), testing::stepFrame(frameNs(n), playerPoses(n))}),
        names, played);
  }
  played.state_hash =
      testing::read<std::uint64_t>(client.ask2(Type::hash, 0, {testing::appIndex(0)}).at(1), 0);
  client.quit();
  return played;
}

TEST(Server, BothProtocolsGiveTheBitsOfTheAppInProcess) {
  const std::pair<const char*, int> rounds[] = {{"null", 400}, {"automatic", 60}};
  for (const auto& [renderer, frames] : rounds) {
    const testing::Played expected = testing::playInProcess(
        frames, 5, render::Renderer::create(render::rendererKindFromName(renderer)));
    Running first(settings(renderer));
    EXPECT_TRUE(playProtocol1(first.endpoint, frames, 5) == expected) << renderer;
    EXPECT_EQ(first.ending(), Ending::quit);
    Running second(settings(renderer));
    EXPECT_TRUE(playProtocol2(second.endpoint, frames, 5) == expected) << renderer;
    EXPECT_EQ(second.ending(), Ending::quit);
    // The player scores, so that the rounds say something.
    EXPECT_GT(expected.logs.back().at("Points") + expected.logs.back().at("Contacts"), 0.0);
  }
}

TEST(Server, ListensOnAFileToo) {
  const sim2vr::testing::OwnFolder folder;
  ServerSettings values = settings();
  values.address = "ipc://" + (folder / "server.ipc").string();
  EXPECT_TRUE(values.isLocal());
  Running server(values);
  EXPECT_EQ(server.endpoint, values.address);
  Client client(server.endpoint);
  client.ask2(Type::hello, 0, {"{}"});
  client.quit();
  EXPECT_EQ(server.ending(), Ending::quit);
}

TEST(Server, APortInUseIsAnError) {
  const Running first(settings());
  ServerSettings values = settings();
  values.port = std::stoi(first.endpoint.substr(first.endpoint.rfind(':') + 1));
  try {
    const Server second(values);
    FAIL() << "no error";
  } catch (const InvalidArgument& error) {
    EXPECT_EQ(error.field(), "port");
    EXPECT_NE(std::string(error.what()).find("expected a free port"), std::string::npos);
  }
  values.address = "192.0.2.1";  // an address for documentation, of no machine
  EXPECT_THROW(Server(std::move(values)), InvalidArgument);
}

TEST(Server, Endpoints) {
  ServerSettings values;
  EXPECT_EQ(values.endpoint(), "tcp://127.0.0.1:5555");
  EXPECT_TRUE(values.isLocal());
  values.address = "::1";
  values.port = 0;
  EXPECT_EQ(values.endpoint(), "tcp://[::1]:*");
  EXPECT_TRUE(values.isLocal());
  values.address = "0.0.0.0";
  EXPECT_FALSE(values.isLocal());
  values.port = 65536;
  EXPECT_THROW(values.endpoint(), InvalidArgument);
}

TEST(Server, ASecondClientIsRefusedAtOnce) {
  Running server(settings());
  Client owner(server.endpoint);
  owner.ask2(Type::hello, 0, {"{}"});
  Client second(server.endpoint);
  const Reply refused = second.ask2(Type::hello, 0, {"{}"});
  EXPECT_EQ(protocol2::decodeHeader(refused[0]).status, 5U);
  EXPECT_EQ(refused[1].find("busy: another client owns the session"), 0U);
  Client third(server.endpoint);
  EXPECT_EQ(third.ask1(handshakeJson())["error"]["code"], "busy");
  EXPECT_EQ(protocol2::decodeHeader(
                owner.ask2(Type::reset, 1, {testing::resetRecord(0, 1, 0, playerPoses(0)), ""})[0])
                .status,
            0U);
  owner.quit();
  EXPECT_EQ(server.ending(), Ending::quit);
}

TEST(Server, AClientThatVanishesEndsTheSession) {
  for (const bool mid_step : {false, true}) {
    Running server(settings());
    {
      Client client(server.endpoint);
      client.ask1(handshakeJson());
      client.ask1(stateJson(playerPoses(0), 0.0, true));
      if (mid_step) client.send({stateJson(playerPoses(1), 0.05).dump()});
    }
    EXPECT_EQ(server.ending(), Ending::client_vanished);
  }
}

TEST(Server, AQuitBeforeTheConnectionGoesIsAQuit) {
  // As User-in-the-Box ends: quit is sent and the socket closed without waiting for the answer.
  for (int i = 0; i < 60; ++i) {
    Running server(settings());
    {
      zmq::context_t context;
      zmq::socket_t socket(context, zmq::socket_type::req);
      socket.connect(server.endpoint);
      socket.send(zmq::buffer(handshakeJson().dump()), zmq::send_flags::none);
      zmq::message_t greeting;
      ASSERT_TRUE(socket.recv(greeting));
      socket.send(zmq::buffer(std::string(R"({"quitApplication": true})")), zmq::send_flags::none);
    }
    ASSERT_EQ(server.ending(), Ending::quit) << "after " << i;
  }
}

TEST(Server, AConnectionWithoutASessionMayGoAway) {
  Running server(settings());
  for (int i = 0; i < 5; ++i) {
    Client client(server.endpoint);
    client.ask({"rubbish"});
  }
  Client owner(server.endpoint);
  owner.ask2(Type::hello, 0, {"{}"});
  for (int i = 0; i < 5; ++i) {
    Client other(server.endpoint);
    other.ask2(Type::hello, 0, {"{}"});
  }
  owner.quit();
  EXPECT_EQ(server.ending(), Ending::quit);
}

TEST(Server, SilenceEndsTheSessionAndTheWaitForAClient) {
  ServerSettings values = settings();
  values.timeout = std::chrono::milliseconds(200);
  Running alone(values);
  EXPECT_EQ(alone.ending(), Ending::timed_out);
  // The client has to have come by then, on a busy machine too.
  values.timeout = std::chrono::milliseconds(2000);
  Running silent(values);
  Client client(silent.endpoint);
  client.ask1(handshakeJson());
  EXPECT_EQ(silent.ending(), Ending::timed_out);
}

TEST(Server, KeepsOnServingWhereAsked) {
  ServerSettings values = settings();
  values.keep = true;
  values.timeout = std::chrono::milliseconds(60'000);
  Running server(values);
  for (int i = 0; i < 3; ++i) {
    Client client(server.endpoint);
    client.ask2(Type::hello, 0, {"{}"});
    if (i != 1) client.quit();  // the second one vanishes
    if (i == 1) continue;
  }
  // A client that comes after a vanished client is served once the server has noticed.
  Client last(server.endpoint);
  Reply reply;
  do {
    reply = last.ask2(Type::hello, 0, {"{}"});
  } while (protocol2::decodeHeader(reply[0]).status == 5U);
  EXPECT_EQ(protocol2::decodeHeader(reply[0]).status, 0U);
  server.stop();
  EXPECT_EQ(server.ending(), Ending::stopped);
}

TEST(Server, StopsWhenAskedInTheMiddleOfARound) {
  Running server(settings());
  Client client(server.endpoint);
  client.ask1(handshakeJson());
  client.ask1(stateJson(playerPoses(0), 0.0, true));
  server.stop();
  EXPECT_EQ(server.ending(), Ending::stopped);
}

TEST(Server, MessagesOfAnyShapeAreAnswered) {
  Running server(settings());
  Client client(server.endpoint, zmq::socket_type::dealer);
  client.send({"", message2(Type::hello, 0, {"{}"})[0], "{}"});
  EXPECT_EQ(protocol2::decodeHeader(client.receive().at(1)).status, 0U);
  const std::vector<Reply> messages = {
      {""},                                  // a delimiter and nothing else
      {"", "S2VR"},                          // a header cut short
      {"", message2(Type::step, 1, {})[0]},  // frames missing
      {"", message2(Type::step, 1, {})[0], "", "", "", "", ""},
      {"", "{\"headsetPosition\": "},                 // another protocol, cut short
      {message2(Type::quit, 0, {})[0].substr(0, 5)},  // no delimiter
      Reply(1000, "x"),                               // very many frames
      {"", std::string(8 << 20, '\xff')},             // a big one
  };
  for (std::size_t i = 0; i < messages.size(); ++i) {
    client.send(messages[i]);
    EXPECT_FALSE(client.receive().empty()) << "message " << i;
  }
  client.send({"", message2(Type::quit, 0, {})[0]});
  EXPECT_EQ(protocol2::decodeHeader(client.receive().at(1)).status, 0U);
  EXPECT_EQ(server.ending(), Ending::quit);
}

TEST(Server, AHugeFrameCostsTheConnectionOnly) {
  ServerSettings values = settings();
  values.keep = true;
  Running server(values);
  {
    Client huge(server.endpoint);
    huge.send({std::string((64 << 20) + 1, ' ')});
    Client other(server.endpoint);
    EXPECT_EQ(protocol2::decodeHeader(other.ask2(Type::hello, 0, {"{}"})[0]).status, 0U);
    other.quit();
  }
  server.stop();
  EXPECT_EQ(server.ending(), Ending::stopped);
}

TEST(Server, PacesFramesForPeopleWhoWatch) {
  ServerSettings values = settings();
  values.host.realtime = true;
  Running server(values);
  Client client(server.endpoint);
  client.ask1(handshakeJson());  // timeScale 5
  // Before the reset: a busy machine may deliver its answer late.
  const auto start = std::chrono::steady_clock::now();
  client.ask1(stateJson(playerPoses(0), 0.0, true));
  for (int n = 1; n <= 20; ++n) client.ask1(stateJson(playerPoses(n), 0.05 * n));
  // 20 frames of 50 ms of game time after the first one, five times as fast: at least 0.2 s.
  EXPECT_GE(std::chrono::steady_clock::now() - start, std::chrono::milliseconds(199));
  client.ask1({{"quitApplication", true}});
}

TEST(Server, WritesLogsAndPicturesPerSessionAndApp) {
  const sim2vr::testing::OwnFolder root;
  ServerSettings values = settings();
  values.keep = true;
  values.host.app.log_dir = root / "logs";
  values.host.recorder = runtime::RecorderSettings{.folder = root / "recording", .size = {32, 24}};
  {
    Running server(values);
    for (int session = 0; session < 2; ++session) {
      Client client(server.endpoint);
      client.ask2(Type::hello, 0, {R"({"apps": 2})"});
      for (const std::uint32_t app : {0U, 1U}) {
        client.ask2(Type::reset, 1, {testing::resetRecord(app, 1, 0, playerPoses(0)), ""});
        client.ask2(Type::step, 1,
                    {testing::stepRecord(app, 1), testing::stepFrame(frameNs(1), playerPoses(1))});
      }
      client.quit();
    }
    server.stop();
    EXPECT_EQ(server.ending(), Ending::stopped);
  }
  for (const char* session : {"", "session001"}) {
    for (const char* app : {"app000", "app001"}) {
      EXPECT_TRUE(exists(root / "logs" / session / app / "0000-hard" / "states.csv"));
      for (const char* camera : {"envCamera", "mainCamera"}) {
        const auto folder = root / "recording" / session / app / camera;
        EXPECT_TRUE(exists(folder / "image0.png"));
        EXPECT_TRUE(exists(folder / "image1.png"));
        EXPECT_FALSE(exists(folder / "image2.png"));
      }
    }
  }
}

}  // namespace
}  // namespace sim2vr::server

// SPDX-License-Identifier: Apache-2.0
// Sessions of protocol 1 without a socket.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "players.hpp"
#include "png_image.hpp"
#include "sim2vr/server/session.hpp"

namespace sim2vr::server {
namespace {

using testing::frameNs;
using testing::handshakeJson;
using testing::Json;
using testing::playerPoses;
using testing::stateJson;

HostSettings settings(const std::string& renderer = "null") {
  HostSettings host;
  host.app = testing::appSettings();
  host.renderer = renderer;
  return host;
}

/// A client of protocol 1.
class Client {
 public:
  explicit Client(const HostSettings& host, const Json& handshake = handshakeJson()) : host_(host) {
    Opening opening = openSession(host_, testing::views({handshake.dump()}));
    greeting = opening.reply.at(0);
    session = std::move(opening.session);
  }

  Json askText(const std::string& text) {
    return Json::parse(session->answer(testing::views({text})).at(0));
  }
  Json ask(const Json& message) { return askText(message.dump()); }

  std::string greeting;
  std::unique_ptr<Session> session;

 private:
  AppHost host_;
};

Json ourHandshake() {
  Json handshake = handshakeJson();
  handshake["frameTime"] = "current";
  handshake["clock"] = "round";
  handshake["headRotation"] = "device";
  return handshake;
}

std::string errorOf(const Json& reply) {
  if (!reply.contains("error")) return "none";
  EXPECT_TRUE(reply["isFinished"]);
  EXPECT_EQ(reply["image"], Json::array());
  return reply["error"]["code"].get<std::string>() + ": " +
         reply["error"]["message"].get<std::string>();
}

/// The player with the head turned to a pitch, degrees up: about the x axis of a left-handed frame,
/// which points right, by as much down.
xr::DeviceState turned(TrackedPoses poses, double pitch_deg) {
  const double half_rad = -0.5 * pitch_deg * std::numbers::pi / 180.0;
  poses.head[3] = std::sin(half_rad);
  poses.head[4] = poses.head[5] = 0.0;
  poses.head[6] = std::cos(half_rad);
  return poses.devices();
}

/// Hash of a round in process whose frames lie at the given times, with the head turned as the game
/// requests it, or as the player holds it.
std::uint64_t hashInProcess(std::uint32_t seed, const std::vector<std::int64_t>& times_ns,
                            bool turns_head = true) {
  runtime::App app(testing::appSettings(), render::Renderer::create(render::RendererKind::null));
  const double pitch_deg = app.headRequest({.seed = seed}).value();
  for (std::size_t n = 0; n < times_ns.size(); ++n) {
    const TrackedPoses player = playerPoses(static_cast<int>(n));
    const xr::DeviceState poses = turns_head ? turned(player, pitch_deg) : player.devices();
    if (n == 0) {
      app.reset({.seed = seed, .time_ns = times_ns[0]}, poses);
    } else {
      app.step({times_ns[n], poses});
    }
  }
  return app.stateHash();
}

std::string hexadecimal(std::uint64_t value) { return fmt::format("{:016x}", value); }

TEST(Session1, GreetingIsTheReferences) {
  const Client client(settings());
  EXPECT_EQ(client.greeting,
            R"({"isFinished":false,"reward":0.0,"image":[],"timeFeature":-1.0,"logDict":"null"})");
}

TEST(Session1, GreetsClientsThatKnowUsWithItsName) {
  const Client client(settings(), ourHandshake());
  EXPECT_EQ(Json::parse(client.greeting)["server"].get<std::string>().find("sim2vr-app "), 0U);
}

TEST(Session1, RefusesOtherFirstMessages) {
  AppHost host(settings());
  for (const std::string& text :
       {std::string("{}"), stateJson(playerPoses(0), 0.0, true).dump(), std::string("hello"),
        std::string(R"({"quitApplication": true})")}) {
    const Opening opening = openSession(host, testing::views({text}));
    EXPECT_EQ(opening.session, nullptr);
    EXPECT_EQ(Json::parse(opening.reply.at(0))["error"]["code"], "malformed_message") << text;
  }
  const Opening two_frames = openSession(host, testing::views({handshakeJson().dump(), ""}));
  EXPECT_EQ(two_frames.session, nullptr);
  const Opening none = openSession(host, Frames{});
  EXPECT_EQ(none.session, nullptr);
  Json quick = handshakeJson();
  quick["timestep"] = 1e-9;
  EXPECT_EQ(errorOf(Json::parse(openSession(host, testing::views({quick.dump()})).reply.at(0))),
            "invalid_argument: fixed_delta_time_s: got 1e-09, expected 1e-5 s or above");
}

TEST(Session1, UserInTheBoxPlaysRoundsOnOneClock) {
  HostSettings host = settings();
  host.fixed_seed = 7;
  host.app.options_json = R"({"condition": "hard", "round_seconds": 1.0})";
  Client client(host);
  double clock_s = 0.0;
  for (int round = 0; round < 3; ++round) {
    Json reply = client.ask(stateJson(playerPoses(0), clock_s, true));
    EXPECT_EQ(errorOf(reply), "none");
    EXPECT_FALSE(reply["isFinished"]);
    EXPECT_EQ(reply["timeFeature"], -1.0);
    int steps = 0;
    while (!reply["isFinished"]) {
      for (int substep = 0; substep < 25; ++substep) clock_s += 0.002;
      reply = client.ask(stateJson(playerPoses(++steps), clock_s));
      EXPECT_EQ(errorOf(reply), "none");
    }
    // Frames lie one step ahead of the user's clock: the first one after 1 s is that of step 20.
    EXPECT_EQ(steps, 20);
    EXPECT_TRUE(Json::parse(reply["logDict"].get<std::string>()).contains("Points"));
    EXPECT_EQ(client.askText(stateJson(playerPoses(0), clock_s).dump())["error"]["code"],
              "state_error");
  }
}

TEST(Session1, FramesLieAtTheNextTimestepOfTheAbsoluteClock) {
  HostSettings host = settings();
  host.fixed_seed = 7;
  Client client(host);
  client.ask(stateJson(playerPoses(0), 5.0, true));
  client.ask(stateJson(playerPoses(1), 5.05));
  Json last = stateJson(playerPoses(2), 5.1);
  last["stateHash"] = true;
  EXPECT_EQ(client.ask(last)["stateHash"],
            hexadecimal(hashInProcess(7, {frameNs(100), frameNs(102), frameNs(103)})));
}

TEST(Session1, SwitchesPutFramesAtTheCurrentTimestepOfTheRound) {
  for (const bool by_handshake : {true, false}) {
    HostSettings host = settings();
    if (!by_handshake) {
      host.frame_time = protocol1::FrameTime::current;
      host.clock = protocol1::ClockOrigin::round;
    }
    Client client(host, by_handshake ? ourHandshake() : handshakeJson());
    Json first = stateJson(playerPoses(0), 5.0, true);
    first["seed"] = 7;
    client.ask(first);
    client.ask(stateJson(playerPoses(1), 5.05));
    Json last = stateJson(playerPoses(2), 5.1);
    last["stateHash"] = true;
    EXPECT_EQ(client.ask(last)["stateHash"],
              hexadecimal(hashInProcess(7, {0, frameNs(1), frameNs(2)}, !by_handshake)));
  }
}

/// The alpha channel, depth, in the middle of the picture that answers a state.
int depthAhead(const Json& reply) {
  const testing::Image picture = testing::decodePng(reply["image"]);
  return picture.rgba.at(4 * (40 * 120 + 60) + 3);
}

TEST(Session1, TurnsTheHeadAsTheReferencesAppDoes) {
  // Low targets want the head 30 degrees down: whichever way the user looks, the app shows the
  // same.
  HostSettings host = settings("automatic");
  host.app.options_json = R"({"condition": "low"})";
  host.fixed_seed = 7;
  TrackedPoses up = playerPoses(0);
  up.head = {0.0, 1.2, 0.0, std::sin(-0.5), 0.0, 0.0, std::cos(-0.5)};
  TrackedPoses down = up;
  const double half_rad = 15.0 * std::numbers::pi / 180.0;
  down.head = {0.0, 1.2, 0.0, std::sin(half_rad), 0.0, 0.0, std::cos(half_rad)};
  Client turning(host);
  const Json as_app = turning.ask(stateJson(up, 0.0, true));
  Client free(host, ourHandshake());
  Json state = stateJson(down, 0.0, true);
  state["seed"] = 7;
  const Json as_device = free.ask(state);
  EXPECT_NEAR(depthAhead(as_app), depthAhead(as_device), 1);
  state = stateJson(up, 0.0, true);
  state["seed"] = 7;
  EXPECT_NE(free.ask(state)["image"], as_device["image"]);
}

TEST(Session1, SaysHowTheHeadShallBeHeld) {
  Client client(settings(), ourHandshake());
  Json state = {{"headRequest", {{"seed", 7}, {"options", {{"condition", "low"}}}}}};
  Json reply = client.ask(state);
  EXPECT_EQ(errorOf(reply), "none");
  EXPECT_NEAR(reply["headRequest"]["pitch_deg"].get<double>(), -30.0, 1e-4);
  state["headRequest"]["options"] = {{"head_request", false}};
  EXPECT_EQ(client.ask(state)["headRequest"]["pitch_deg"], nullptr);
  EXPECT_EQ(errorOf(client.ask({{"headRequest", {{"seed", -1}}}})).find("malformed_message"), 0U);
  // It has started nothing.
  EXPECT_EQ(errorOf(client.ask(stateJson(playerPoses(0), 0.0))),
            "state_error: step: no round was started; call reset first");
}

TEST(Session1, ExactTimesAndFramesOfOurClients) {
  Client client(settings(), ourHandshake());
  Json first = stateJson(playerPoses(0), 0.0, true);
  first["seed"] = 7;
  first["timeNs"] = 1000;
  client.ask(first);
  Json second = stateJson(playerPoses(1), 0.0);
  second["timeNs"] = 2'345'678;
  client.ask(second);
  Json third = stateJson(playerPoses(3), 0.0);
  for (const int n : {2, 3}) {
    Json frame = testing::posesJson(playerPoses(n));
    frame["time_ns"] = n * 10'000'000;
    third["frames"].push_back(frame);
  }
  third["stateHash"] = true;

  runtime::App app(testing::appSettings(), render::Renderer::create(render::RendererKind::null));
  app.reset({.seed = 7, .time_ns = 1000}, playerPoses(0).devices());
  app.step({2'345'678, playerPoses(1).devices()});
  const std::vector<runtime::FrameInput> frames{{20'000'000, playerPoses(2).devices()},
                                                {30'000'000, playerPoses(3).devices()}};
  const runtime::StepResult expected = app.step(frames);
  const Json reply = client.ask(third);
  EXPECT_EQ(errorOf(reply), "none");
  EXPECT_EQ(static_cast<float>(reply["reward"].get<double>()), expected.reward);
  EXPECT_EQ(reply["stateHash"], hexadecimal(app.stateHash()));
}

TEST(Session1, SeedsOfRounds) {
  const auto hashes = [](HostSettings host) {
    Client client(host);
    std::vector<std::string> found;
    for (int round = 0; round < 3; ++round) {
      Json state = stateJson(playerPoses(0), 0.0, true);
      state["stateHash"] = true;
      found.push_back(client.ask(state)["stateHash"]);
    }
    return found;
  };
  HostSettings fixed = settings();
  fixed.fixed_seed = 9;
  const std::vector<std::string> same = hashes(fixed);
  EXPECT_EQ(same, std::vector<std::string>(3, hexadecimal(hashInProcess(9, {0}))));
  const std::vector<std::string> drawn = hashes(settings());
  EXPECT_NE(drawn[0], drawn[1]);
  EXPECT_NE(drawn[1], drawn[2]);
  EXPECT_NE(hashes(settings())[0], drawn[0]);
}

TEST(Session1, TheUserEndsTheRound) {
  Client client(settings());
  client.ask(stateJson(playerPoses(0), 0.0, true));
  Json last = stateJson(playerPoses(1), 0.05);
  last["isFinished"] = true;
  const Json reply = client.ask(last);
  EXPECT_TRUE(reply["isFinished"]);
  EXPECT_EQ(errorOf(reply), "none");
  EXPECT_NE(reply["image"], Json::array());
  EXPECT_EQ(errorOf(client.ask(stateJson(playerPoses(2), 0.1))),
            "state_error: step: the round is over (the user's isFinished); send a reset or quit");
  EXPECT_EQ(errorOf(client.ask(stateJson(playerPoses(2), 0.1, true))), "none");
}

TEST(Session1, Quit) {
  Client client(settings());
  client.ask(stateJson(playerPoses(0), 0.0, true));
  EXPECT_FALSE(client.session->over());
  EXPECT_TRUE(client.askText(R"({"quitApplication": true})")["isFinished"]);
  EXPECT_TRUE(client.session->over());
}

TEST(Session1, RefusedStatesLeaveTheRoundAsItWas) {
  HostSettings host = settings();
  host.fixed_seed = 7;
  Client client(host);
  EXPECT_EQ(errorOf(client.ask(stateJson(playerPoses(0), 0.0))),
            "state_error: step: no round was started; call reset first");
  client.ask(stateJson(playerPoses(0), 0.0, true));
  client.ask(stateJson(playerPoses(1), 0.05));

  Json long_rotation = stateJson(playerPoses(2), 0.1);
  long_rotation["rightControllerRotation"]["w"] = 2.0;
  EXPECT_EQ(errorOf(client.ask(long_rotation)).find("invalid_argument: right_controller.rotation"),
            0U);
  Json no_head = stateJson(playerPoses(2), 0.1);
  no_head.erase("headsetRotation");
  EXPECT_EQ(errorOf(client.ask(no_head)),
            "invalid_argument: head.rotation: got (-0.000000, -0.000000, 0.000000, 0.000000), "
            "expected a unit quaternion x y z w (length 1 within 0.001)");
  EXPECT_EQ(errorOf(client.ask(stateJson(playerPoses(2), 0.0))),
            "invalid_argument: currentTimestep: got 0.000000, expected a time not before the "
            "previous state's 0.050000 (clocks must not go backwards)");
  Json no_next = stateJson(playerPoses(2), 0.1);
  no_next.erase("nextTimestep");
  EXPECT_EQ(errorOf(client.ask(no_next)),
            "invalid_argument: nextTimestep: got 0.000000, expected a time not before "
            "currentTimestep 0.100000");
  EXPECT_EQ(errorOf(client.ask(stateJson(playerPoses(2), -1.0, true))).find("invalid_argument"),
            0U);
  Json bad_option = stateJson(playerPoses(2), 0.1, true);
  bad_option["options"] = {{"condition", "nosuch"}};
  EXPECT_EQ(errorOf(client.ask(bad_option)).find("invalid_argument: option 'condition'"), 0U);
  EXPECT_EQ(errorOf(client.askText(R"({"headsetPosition": NaN})")).find("malformed_message"), 0U);
  EXPECT_EQ(errorOf(client.ask(handshakeJson())),
            "state_error: handshake: got a second one, expected a state; connect anew to start "
            "over");
  EXPECT_EQ(errorOf(client.ask({{"render", {{"view", "cellar"}}}})).find("invalid_argument: view"),
            0U);
  const Reply two = client.session->answer(testing::views({"{}", "{}"}));
  EXPECT_EQ(errorOf(Json::parse(two[0])),
            "malformed_message: state: got 2 frames, expected one of JSON text");
  EXPECT_EQ(client.session->answer(Frames{}).size(), 1U);
  const Reply other =
      client.session->answer(testing::views(testing::message2(protocol2::Type::quit, 0, {})));
  EXPECT_EQ(protocol2::decodeHeader(other[0]).status, 2U);

  Json last = stateJson(playerPoses(2), 0.1);
  last["stateHash"] = true;
  EXPECT_EQ(client.ask(last)["stateHash"],
            hexadecimal(hashInProcess(7, {0, frameNs(2), frameNs(3)})));
}

TEST(Session1, SavesAndLoads) {
  Client client(settings(), ourHandshake());
  const Json query{{"stateHash", true}, {"save", true}};
  EXPECT_EQ(errorOf(client.ask(query)).find("state_error"), 0U);
  Json first = stateJson(playerPoses(0), 0.0, true);
  first["seed"] = 3;
  client.ask(first);
  client.ask(stateJson(playerPoses(1), 0.05));
  const Json saved = client.ask(query);
  EXPECT_EQ(saved["image"], Json::array());
  EXPECT_EQ(client.ask(query)["stateHash"], saved["stateHash"]);
  client.ask(stateJson(playerPoses(2), 0.1));
  const Json loaded = client.ask({{"load", saved["state"]}, {"stateHash", true}});
  EXPECT_EQ(loaded["stateHash"], saved["stateHash"]);
  EXPECT_NE(loaded["image"], Json::array());
  // The clock goes on from the saved frame.
  EXPECT_EQ(errorOf(client.ask(stateJson(playerPoses(2), 0.1))), "none");
  EXPECT_EQ(errorOf(client.ask({{"load", "Zm9v"}})).find("engine_error: saved state"), 0U);
  EXPECT_EQ(errorOf(client.ask(stateJson(playerPoses(2), 0.15))).find("state_error"), 0U);
  EXPECT_EQ(errorOf(client.ask(first)), "none");
}

TEST(Session1, ImagesArePngsOfTheSamePixels) {
  Client client(settings("automatic"), ourHandshake());
  Json first = stateJson(playerPoses(0), 0.0, true);
  first["seed"] = 3;
  first["render"] = {{"view", "recorder"}, {"width", 64}, {"height", 48}};
  const Json reply = client.ask(first);

  runtime::App app(testing::appSettings(), render::Renderer::create());
  app.reset({.seed = 3}, playerPoses(0).devices());
  const testing::Image image = testing::decodePng(reply["image"]);
  EXPECT_EQ(image.size, (render::ImageSize{120, 80}));
  EXPECT_TRUE(std::equal(app.image().begin(), app.image().end(), image.rgba.begin()));
  std::vector<std::uint8_t> picture(4 * 64 * 48);
  app.renderView(runtime::View::recorder, {64, 48}, picture);
  EXPECT_TRUE(testing::decodePng(reply["render"]).rgba == picture);
}

/// The player with a hammer that creeps, at 0.24 m/s: it touches targets too slowly to hit them.
TrackedPoses creepingPlayer(int n) {
  TrackedPoses poses = playerPoses(n);
  poses.right[2] = 0.2 + 0.012 * (n % 14);
  return poses;
}

// User-in-the-Box's monitor adds up what each step logs under the reference's names.
TEST(Session1, StepsOfARoundLogTheReferencesTermsAndTheirSums) {
  HostSettings host = settings();
  host.fixed_seed = 7;  // a round in which the hammer comes to a target
  for (const int frames : {1, 3}) {
    Client client(host, ourHandshake());
    client.ask(stateJson(playerPoses(0), 0.0, true));
    double distance = 0.0;
    double contacts = 0.0;
    double reward = 0.0;
    Json log;
    for (int n = 1; n <= 200; ++n) {
      Json state = stateJson(creepingPlayer(n), 0.05 * n);
      for (int k = 1; frames > 1 && k <= frames; ++k) {
        Json frame = testing::posesJson(creepingPlayer(n));
        frame["time_ns"] = frameNs(n - 1) + k * (frameNs(n) - frameNs(n - 1)) / frames;
        state["frames"].push_back(frame);
      }
      const Json reply = client.ask(state);
      log = Json::parse(reply["logDict"].get<std::string>());
      distance += log["DistanceReward"].get<double>();
      contacts += log["RewardUnsuccessfulContact"].get<double>();
      reward += reply["reward"].get<double>();
    }
    EXPECT_LT(distance, -1.0);
    EXPECT_GT(contacts, 0.0);
    EXPECT_NEAR(distance, log["DistanceRewardSum"].get<double>(), 1e-9);
    EXPECT_NEAR(contacts, log["RewardUnsuccessfulContactSum"].get<double>(), 1e-9);
    EXPECT_NEAR(reward, distance + contacts + 10.0 * log["Points"].get<double>(), 1e-4);
  }
}

TEST(Session1, ASparseRewardHasNoTerms) {
  HostSettings sparse = settings();
  sparse.app.options_json = R"({"condition": "hard", "sparse": true})";
  Client client(sparse);
  client.ask(stateJson(playerPoses(0), 0.0, true));
  const Json reply = client.ask(stateJson(playerPoses(1), 0.05));
  const Json log = Json::parse(reply["logDict"].get<std::string>());
  for (const char* name : {"DistanceReward", "DistanceRewardSum", "RewardUnsuccessfulContact",
                           "RewardUnsuccessfulContactSum"}) {
    EXPECT_FALSE(log.contains(name)) << name;
  }
  EXPECT_EQ(log["Points"], 0.0);
}

}  // namespace
}  // namespace sim2vr::server

// SPDX-License-Identifier: Apache-2.0
// Sessions of protocol 2 without a socket.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <limits>

#include "own_loop.hpp"
#include "players.hpp"
#include "sim2vr/server/session.hpp"

namespace sim2vr::server {
namespace {

using protocol2::Type;
using testing::appIndex;
using testing::frameNs;
using testing::Json;
using testing::message2;
using testing::playerPoses;
using testing::read;
using testing::resetRecord;
using testing::stepFrame;
using testing::stepRecord;

constexpr std::size_t kImageBytes = 4 * 120 * 80;

HostSettings settings(const std::string& renderer = "null") {
  HostSettings host;
  host.app = testing::appSettings();
  host.renderer = renderer;
  return host;
}

class Client {
 public:
  Client(const HostSettings& host, const Json& hello) : host_(host) {
    Opening opening = openSession(host_, testing::views(message2(Type::hello, 0, {hello.dump()})));
    greeting = std::move(opening.reply);
    session = std::move(opening.session);
  }

  Reply ask(Type type, std::uint32_t count, const std::vector<std::string>& frames) {
    return session->answer(testing::views(message2(type, count, frames)));
  }
  Reply reset(std::uint32_t app, std::uint32_t seed, int frame = 0) {
    return ask(Type::reset, 1, {resetRecord(app, seed, 0, playerPoses(frame)), ""});
  }
  Reply step(std::uint32_t app, int n) {
    return ask(Type::step, 1, {stepRecord(app, 1), stepFrame(frameNs(n), playerPoses(n))});
  }
  std::uint64_t hash(std::uint32_t app) {
    return read<std::uint64_t>(ask(Type::hash, 0, {appIndex(app)}).at(1), 0);
  }

  Reply greeting;
  std::unique_ptr<Session> session;

 private:
  AppHost host_;
};

std::string errorOf(const Reply& reply) {
  const std::uint32_t status = protocol2::decodeHeader(reply.at(0)).status;
  return status == 0 ? "none" : std::to_string(status) + " " + reply.at(1);
}

std::uint32_t recordStatus(const Reply& reply, std::size_t record) {
  return read<std::uint32_t>(reply.at(1), testing::kResultBytes * record + 16);
}

TEST(Session2, HelloSaysWhatThereIs) {
  const Client client(settings(), {{"apps", 2}, {"game", "sample"}, {"width", 60}});
  ASSERT_NE(client.session, nullptr);
  const Json about = Json::parse(client.greeting.at(1));
  EXPECT_EQ(about["server"], "sim2vr-app");
  EXPECT_EQ(about["game"], "sample");
  EXPECT_EQ(about["apps"], 2);
  EXPECT_EQ(about["width"], 60);
  EXPECT_EQ(about["height"], 80);
  EXPECT_EQ(about["renderer_description"], "null renderer: no pictures");
  EXPECT_EQ(about["shared_memory"], nullptr);
  EXPECT_EQ(about["eyes"], 1);
  EXPECT_EQ(about["facts"], Json::parse(games::gameFactsJson("sample")));
  EXPECT_EQ(about["capabilities"],
            (Json{"save", "views", "frames", "inputs", "left_controller", "haptics", "sounds",
                  "head_request", "two_eyes", "scene", "observers"}));
}

TEST(Session2, AnswersAtOnceWhenTheServerIsAskedToEnd) {
  std::atomic<bool> stop = false;
  AppHost host(settings());
  host.stopOn(&stop);
  Opening opening =
      openSession(host, testing::views(message2(Type::hello, 0, {Json{{"apps", 2}}.dump()})));
  stop = true;
  const std::string records =
      resetRecord(0, 1, 0, playerPoses(0)) + resetRecord(1, 2, 0, playerPoses(0));
  const Reply reply =
      opening.session->answer(testing::views(message2(Type::reset, 2, {records, ""})));
  EXPECT_EQ(recordStatus(reply, 0), static_cast<std::uint32_t>(protocol2::Status::state_error));
  EXPECT_EQ(recordStatus(reply, 1), static_cast<std::uint32_t>(protocol2::Status::state_error));
  EXPECT_EQ(reply.at(5), R"(["the app was asked to end","the app was asked to end"])");
}

/// As messages say it.
Json ownLoopHello() { return {{"width", 4}, {"height", 2}, {"apps", 2}}; }

HostSettings ownLoop(const runtime::Capabilities& capabilities) {
  HostSettings host = settings();
  host.make_app = runtime::testing::OwnLoop::factory(capabilities);
  host.facts_json = nullptr;
  return host;
}

TEST(Session2, PlaysAnAppWithALoopOfItsOwn) {
  Client client(ownLoop({runtime::Capability::frames, runtime::Capability::inputs}),
                ownLoopHello());
  const Json about = Json::parse(client.greeting.at(1));
  EXPECT_EQ(about["capabilities"], (Json{"frames", "inputs"}));
  EXPECT_EQ(about["renderer_description"], "paints grey");
  EXPECT_EQ(about["facts"], nullptr);
  Reply reply = client.reset(1, 100);
  EXPECT_EQ(errorOf(reply), "none");
  EXPECT_EQ(reply.at(4), std::string(32, 100));
  // Three frames, the second one drawn; the trigger is answered with a pulse in each.
  TrackedPoses pulls = playerPoses(1);
  pulls.right_inputs[0] = 0.5;
  const std::string frames = stepFrame(frameNs(1), pulls) + stepFrame(frameNs(2), pulls) +
                             stepFrame(frameNs(3), playerPoses(3));
  reply = client.ask(Type::step, 1, {stepRecord(1, 3, 1), frames});
  EXPECT_EQ(recordStatus(reply, 0), 0U);
  EXPECT_EQ(reply.at(4), std::string(32, 102));
  EXPECT_EQ(read<double>(reply.at(2), 0), 103.0);
  ASSERT_EQ(reply.at(6).size(), 48U);
  EXPECT_EQ(read<float>(reply.at(6), 4), 0.5F);
  EXPECT_EQ(read<float>(reply.at(6), 8), 100.0F);
}

TEST(Session2, WhatAnAppCannotDoIsRefusedByItsName) {
  Client client(ownLoop({}), ownLoopHello());
  client.reset(0, 1);
  EXPECT_EQ(errorOf(client.ask(Type::save, 0, {appIndex(0)})).find("7 save: "), 0U);
  EXPECT_EQ(errorOf(client.ask(Type::render, 0, {"{}"})).find("7 views: "), 0U);
  EXPECT_EQ(errorOf(client.ask(Type::head_request, 0, {"{}"})).find("7 head_request: "), 0U);
  EXPECT_EQ(errorOf(client.ask(Type::scene, 0, {"{}"})).find("7 scene: "), 0U);
  const auto refusal = [&client](const TrackedPoses& poses) {
    const Reply reply = client.ask(Type::step, 1, {stepRecord(0, 1), stepFrame(frameNs(1), poses)});
    return std::to_string(recordStatus(reply, 0)) + " " + reply.at(5);
  };
  TrackedPoses poses = playerPoses(1);
  poses.right_inputs[5] = 1.0;
  EXPECT_EQ(refusal(poses).find("7 [\"inputs: "), 0U) << refusal(poses);
  poses = playerPoses(1);
  poses.left = poses.right;
  poses.left_tracked = true;
  EXPECT_EQ(refusal(poses).find("7 [\"left_controller: "), 0U) << refusal(poses);
  EXPECT_EQ(refusal(playerPoses(1)), "0 ");
  const Client two(ownLoop({}), {{"eyes", 2}});
  EXPECT_EQ(errorOf(two.greeting).find("7 two_eyes: "), 0U) << errorOf(two.greeting);
}

TEST(Session2, ClientsGetTheEventsThatTheyTake) {
  TrackedPoses pulls = playerPoses(1);
  pulls.right_inputs[0] = 1.0;
  for (const Json& capabilities : {Json{"haptics"}, Json{"sounds", "smells"}}) {
    Json hello = ownLoopHello();
    hello["capabilities"] = capabilities;
    Client client(ownLoop({runtime::Capability::inputs, runtime::Capability::haptics}), hello);
    client.reset(0, 1);
    const Reply reply = client.ask(Type::step, 1, {stepRecord(0, 1), stepFrame(frameNs(1), pulls)});
    EXPECT_EQ(reply.at(6).size(), capabilities == Json{"haptics"} ? 24U : 0U);
  }
}

TEST(Session2, SaysHowTheHeadShallBeHeldInARoundToCome) {
  Client client(settings(), Json::object());
  client.reset(0, 1);
  const std::uint64_t before = client.hash(0);
  const auto pitch = [&client](const Json& request) {
    return Json::parse(client.ask(Type::head_request, 0, {request.dump()}).at(1))["pitch_deg"];
  };
  // 30 degrees down for low targets (docs/reference/games/whacamole.md).
  EXPECT_NEAR(pitch({{"seed", 3}, {"options", {{"condition", "low"}}}}).get<double>(), -30.0, 1e-4);
  EXPECT_NEAR(pitch({{"options", {{"condition", "high"}}}}).get<double>(), 30.0, 1e-4);
  EXPECT_EQ(pitch({{"options", {{"head_request", false}}}}), nullptr);
  EXPECT_EQ(client.hash(0), before);
  EXPECT_EQ(errorOf(client.ask(Type::head_request, 0, {R"({"options": {"nosuch": 1}})"}))
                .find("1 options: got unknown option 'nosuch'"),
            0U);
}

TEST(Session2, RefusedHellosOpenNoSession) {
  const std::pair<Json, const char*> hellos[] = {
      {{{"game", "wackamole"}}, "1 game: got 'wackamole'"},
      {{{"options", {{"nosuch", 1}}}}, "1 options: got unknown option 'nosuch'"},
      {{{"renderer", "vulkan"}}, "1 renderer: got 'vulkan'"},
      {{{"width", 8192}, {"height", 8192}, {"apps", 3}}, "1 apps: got 3 of 8192 x 8192 pixels"},
      {{{"fixed_delta_time_s", 0.0}}, "1 fixed_delta_time_s: got 0"},
      {{{"maximum_delta_time_s", 1e9}}, "1 maximum_delta_time_s: got 1000000000"},
      {{{"fixed_step_tolerance_s", 1.0}}, "1 fixed_step_tolerance_s: got 1"},
      {{{"apps", "two"}}, "4 hello.apps: got \"two\""}};
  for (const auto& [hello, message] : hellos) {
    const Client client(settings(), hello);
    EXPECT_EQ(client.session, nullptr);
    EXPECT_EQ(errorOf(client.greeting).find(message), 0U) << errorOf(client.greeting);
  }
}

TEST(Session2, NamesFoldersOnThisMachineOnly) {
  HostSettings host = settings();
  host.local = false;
  const Client client(host, {{"log_dir", "/tmp/x"}, {"shared_memory", true}});
  EXPECT_EQ(errorOf(client.greeting).find("1 log_dir: got '/tmp/x' from another machine"), 0U);
  const Client other(host, {{"shared_memory", true}});
  EXPECT_EQ(Json::parse(other.greeting.at(1))["shared_memory"], nullptr);
}

TEST(Session2, OtherVersionsAndOrders) {
  AppHost host(settings());
  Reply other = message2(Type::hello, 0, {"{}"});
  other[0][4] = 2;
  Opening opening = openSession(host, testing::views(other));
  EXPECT_EQ(opening.session, nullptr);
  EXPECT_EQ(errorOf(opening.reply)
                .find("6 version: got messages of version 2, expected 3, that of "
                      "sim2vr-app "),
            0U);
  EXPECT_EQ(protocol2::decodeHeader(opening.reply[0]).version, 3);
  opening = openSession(host, testing::views(message2(Type::quit, 0, {})));
  EXPECT_EQ(opening.session, nullptr);
  EXPECT_EQ(errorOf(opening.reply), "2 message: got one before hello, expected hello first");
  opening = openSession(host, testing::views({"S2VR"}));
  EXPECT_EQ(errorOf(opening.reply), "4 header: got 4 bytes, expected 24 bytes");

  Client client(settings(), Json::object());
  EXPECT_EQ(errorOf(client.step(0, 1)), "none");
  const Reply early = client.step(0, 1);
  EXPECT_EQ(recordStatus(early, 0), 2U);
  EXPECT_EQ(early.at(5), R"(["step: no round was started; call reset first"])");
  const Reply text = client.session->answer(testing::views({"{}"}));
  EXPECT_EQ(Json::parse(text.at(0))["error"]["code"], "state_error");
  EXPECT_EQ(client.session->answer(Frames{}).size(), 1U);
}

TEST(Session2, ABatchGivesWhatEachAppGivesAlone) {
  for (const int threads : {1, 2}) {
    HostSettings host = settings();
    host.threads = threads;
    Client client(host, {{"apps", 3}});
    std::string records;
    for (std::uint32_t app = 0; app < 3; ++app)
      records += resetRecord(app, 10 + app, 0, playerPoses(0));
    EXPECT_EQ(errorOf(client.ask(Type::reset, 3, {records, ""})), "none");
    Reply reply;
    for (int n = 1; n <= 40; ++n) {
      // The third app is left out at times and then plays two frames.
      const bool both = n % 2 == 0;
      std::string steps = stepRecord(1, 1) + stepRecord(0, 1);
      std::string frames =
          stepFrame(frameNs(n), playerPoses(n)) + stepFrame(frameNs(n), playerPoses(n));
      if (both) {
        steps += stepRecord(2, 2);
        frames +=
            stepFrame(frameNs(n - 1), playerPoses(n - 1)) + stepFrame(frameNs(n), playerPoses(n));
      }
      reply = client.ask(Type::step, both ? 3 : 2, {steps, frames});
      ASSERT_EQ(errorOf(reply), "none");
    }
    EXPECT_EQ(protocol2::decodeHeader(reply[0]).count, 3U);
    EXPECT_EQ(read<std::uint32_t>(reply[1], 0), 1U);
    EXPECT_EQ(read<std::uint32_t>(reply[1], 2 * testing::kResultBytes), 2U);
    EXPECT_EQ(reply[4].size(), 3 * kImageBytes);
    const auto renderer = render::Renderer::create(render::RendererKind::null);
    const auto alone = testing::playInProcess(40, 11, renderer);
    EXPECT_EQ(client.hash(1), alone.state_hash);
    EXPECT_EQ(read<float>(reply[1], 8), alone.rewards.back());
    EXPECT_EQ(client.hash(0), testing::playInProcess(40, 10, renderer).state_hash);
    runtime::App pairs(testing::appSettings(), renderer);
    pairs.reset({.seed = 12}, playerPoses(0).devices());
    for (int n = 2; n <= 40; n += 2) {
      const std::vector<runtime::FrameInput> frames{{frameNs(n - 1), playerPoses(n - 1).devices()},
                                                    {frameNs(n), playerPoses(n).devices()}};
      pairs.step(frames);
    }
    EXPECT_EQ(client.hash(2), pairs.stateHash());
  }
}

TEST(Session2, ARefusedRecordLeavesItsAppAndTheOthersGoOn) {
  Client client(settings(), {{"apps", 2}});
  client.reset(0, 1);
  client.reset(1, 2);
  client.step(0, 1);
  client.step(1, 1);
  const std::uint64_t before = client.hash(0);
  TrackedPoses bad = playerPoses(2);
  bad.head[0] = std::numeric_limits<double>::quiet_NaN();
  const Reply reply =
      client.ask(Type::step, 2,
                 {stepRecord(0, 1) + stepRecord(1, 1),
                  stepFrame(frameNs(2), bad) + stepFrame(frameNs(2), playerPoses(2))});
  EXPECT_EQ(errorOf(reply), "none");
  EXPECT_EQ(recordStatus(reply, 0), 1U);
  EXPECT_EQ(recordStatus(reply, 1), 0U);
  EXPECT_EQ(reply.at(5), R"(["head.position: got a number that is not finite, expected metres"])");
  EXPECT_EQ(client.hash(0), before);
  EXPECT_EQ(client.hash(1),
            testing::playInProcess(2, 2, render::Renderer::create(render::RendererKind::null))
                .state_hash);

  bad = playerPoses(2);
  bad.head_tracked = false;
  EXPECT_EQ(client.ask(Type::step, 1, {stepRecord(0, 1), stepFrame(frameNs(2), bad)}).at(5),
            R"(["head: got not tracked, expected a tracked headset"])");
  EXPECT_EQ(recordStatus(client.ask(Type::step, 1, {stepRecord(0, 0), ""}), 0), 1U);
  EXPECT_EQ(
      client.step(0, 0).at(5),
      R"--(["time_ns: got 0, expected a time not before the previous frame's 49999997 (clocks )--"
      R"--(must not go backwards)"])--");
}

TEST(Session2, MessagesAboutAppsThatAreNotThereMoveNothing) {
  Client client(settings(), {{"apps", 2}});
  client.reset(0, 1);
  const std::uint64_t before = client.hash(0);
  const std::string frame = stepFrame(frameNs(1), playerPoses(1));
  EXPECT_EQ(
      errorOf(client.ask(Type::step, 2, {stepRecord(0, 1) + stepRecord(2, 1), frame + frame})),
      "1 app: got 2, expected 0 to 1");
  EXPECT_EQ(
      errorOf(client.ask(Type::step, 2, {stepRecord(0, 1) + stepRecord(0, 1), frame + frame})),
      "1 app: got 0 twice, expected each app once in a message");
  EXPECT_EQ(errorOf(client.ask(Type::hash, 0, {appIndex(4294967295U)})),
            "1 app: got 4294967295, expected 0 to 1");
  EXPECT_EQ(client.hash(0), before);
  EXPECT_EQ(errorOf(client.ask(Type::step, 0, {"", ""})), "none");
}

TEST(Session2, SavesLoadsAndDraws) {
  Client client(settings("automatic"), {{"apps", 2}});
  client.reset(0, 1);
  client.reset(1, 2);
  const std::string state = client.ask(Type::save, 0, {appIndex(0)}).at(1);
  const std::string image = client.ask(Type::render, 0, {R"({"app": 0, "view": "headset"})"}).at(1);
  EXPECT_TRUE(client.ask(Type::load, 0, {appIndex(1), state}).at(1) == image);
  EXPECT_EQ(client.hash(1), client.hash(0));
  EXPECT_EQ(errorOf(client.ask(Type::load, 0, {appIndex(1), "rubbish"})).find("3 saved state"), 0U);
  EXPECT_EQ(errorOf(client.ask(Type::render, 0, {R"({"view": "cellar"})"})).find("1 view"), 0U);
  EXPECT_EQ(client.ask(Type::render, 0, {R"({"view": "recorder", "width": 8, "height": 6})"})
                .at(1)
                .size(),
            4U * 8 * 6);
  EXPECT_EQ(errorOf(client.ask(Type::quit, 0, {})), "none");
  EXPECT_TRUE(client.session->over());
}

TEST(Session2, SharedMemoryHoldsTheImagesAndHasNoName) {
  Client client(settings("automatic"), {{"apps", 2}, {"shared_memory", true}});
  const Json shared = Json::parse(client.greeting.at(1))["shared_memory"];
  const std::string path = shared["path"];
  EXPECT_EQ(path.find("/proc/" + std::to_string(::getpid()) + "/fd/"), 0U);
  EXPECT_EQ(std::filesystem::read_symlink(path), shared["link"].get<std::string>());
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  ASSERT_GE(file, 0) << path;
  void* mapped = ::mmap(nullptr, 2 * kImageBytes, PROT_READ, MAP_SHARED, file, 0);
  ::close(file);
  ASSERT_NE(mapped, MAP_FAILED);
  const auto* images = static_cast<const char*>(mapped);

  const Reply reply = client.reset(1, 5);
  EXPECT_EQ(protocol2::decodeHeader(reply[0]).flags, protocol2::kImagesShared);
  EXPECT_EQ(reply[4], "");
  const std::string drawn = client.ask(Type::render, 0, {R"({"app": 1})"}).at(1);
  EXPECT_TRUE(std::string(images + kImageBytes, kImageBytes) == drawn);
  const std::string state = client.ask(Type::save, 0, {appIndex(1)}).at(1);
  client.reset(0, 5, 7);  // the hand is elsewhere
  EXPECT_FALSE(std::string(images, kImageBytes) == drawn);
  client.ask(Type::load, 0, {appIndex(0), state});
  EXPECT_TRUE(std::string(images, kImageBytes) == drawn);
  // Another session's memory is another one, and this one's goes with it.
  const Json other = Json::parse(
      client.ask(Type::hello, 0, {R"({"shared_memory": true})"}).at(1))["shared_memory"];
  EXPECT_NE(other["link"], shared["link"]);
  ::munmap(mapped, 2 * kImageBytes);
}

TEST(Session2, AnotherHelloReplacesTheApps) {
  Client client(settings(), {{"apps", 2}});
  client.reset(1, 1);
  EXPECT_EQ(errorOf(client.ask(Type::hello, 0, {R"({"game": "nosuch"})"})).find("1 game"), 0U);
  EXPECT_EQ(errorOf(client.step(1, 1)), "none");
  EXPECT_EQ(errorOf(client.ask(Type::hello, 0, {R"({"apps": 1, "game": "sample"})"})), "none");
  EXPECT_EQ(errorOf(client.step(1, 1)), "1 app: got 1, expected 0 to 0");
  // The names of the log are sent again.
  EXPECT_NE(client.reset(0, 1).at(3), "");
}

}  // namespace
}  // namespace sim2vr::server

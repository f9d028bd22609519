// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/server/protocol2.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "players.hpp"

namespace sim2vr::server::protocol2 {
namespace {

using testing::Json;

Request decode(const Reply& message) {
  const std::vector<std::string_view> body = testing::views(message);
  return decodeRequest(decodeHeader(body[0]), body);
}

std::string refusal(const Reply& message) {
  try {
    decode(message);
  } catch (const MalformedMessage& error) {
    return error.what();
  }
  return "accepted";
}

TEST(Protocol2, HeaderIs24LittleEndianBytes) {
  const std::string bytes = encodeHeader(
      {.type = 3, .sequence = 0x01020304, .count = 5, .status = 6, .flags = 0x80000000});
  EXPECT_EQ(bytes,
            std::string("S2VR\x03\x00\x03\x00\x04\x03\x02\x01\x05\x00\x00\x00\x06\x00\x00\x00"
                        "\x00\x00\x00\x80",
                        24));
  const Header header = decodeHeader(bytes);
  EXPECT_EQ(header.version, 3);
  EXPECT_EQ(header.type, 3);
  EXPECT_EQ(header.sequence, 0x01020304U);
  EXPECT_EQ(header.count, 5U);
  EXPECT_EQ(header.status, 6U);
  EXPECT_EQ(header.flags, 0x80000000U);
  EXPECT_THROW(decodeHeader(bytes.substr(0, 23)), MalformedMessage);
  EXPECT_THROW(decodeHeader(bytes + "x"), MalformedMessage);
  EXPECT_THROW(decodeHeader("S2VX" + bytes.substr(4)), MalformedMessage);
  EXPECT_THROW(decodeHeader(""), MalformedMessage);
}

TEST(Protocol2, Hello) {
  const auto hello = std::get<Hello>(decode(testing::message2(
      Type::hello, 0,
      {R"({"client": "me", "apps": 3, "game": "sample", "options": {"a": 1}, "width": 60,
           "height": 40, "renderer": "null", "log_dir": "/tmp/x", "fixed_delta_time_s": 0.01,
           "maximum_delta_time_s": 0.5, "fixed_step_tolerance_s": 1e-5,
           "shared_memory": true, "eyes": 2, "ipd_m": 0.06,
           "capabilities": ["sounds", "smells"]})"})));
  EXPECT_EQ(hello.client, "me");
  EXPECT_EQ(hello.apps, 3U);
  EXPECT_EQ(hello.game, "sample");
  EXPECT_EQ(hello.options_json, R"({"a":1})");
  EXPECT_EQ(hello.width, 60);
  EXPECT_EQ(hello.height, 40);
  EXPECT_EQ(hello.renderer, "null");
  EXPECT_EQ(hello.log_dir, "/tmp/x");
  EXPECT_EQ(hello.fixed_delta_time_s, 0.01);
  EXPECT_EQ(hello.maximum_delta_time_s, 0.5);
  EXPECT_EQ(hello.fixed_step_tolerance_s, 1e-5);
  EXPECT_TRUE(hello.shared_memory);
  EXPECT_EQ(hello.eyes, 2);
  EXPECT_EQ(hello.ipd_m, 0.06);
  EXPECT_EQ(hello.capabilities, (std::vector<std::string>{"sounds", "smells"}));
  const auto empty = std::get<Hello>(decode(testing::message2(Type::hello, 0, {"{}"})));
  EXPECT_EQ(empty.apps, 1U);
  EXPECT_FALSE(empty.game);
  EXPECT_FALSE(empty.width);
  EXPECT_FALSE(empty.eyes);
  EXPECT_FALSE(empty.capabilities);
}

TEST(Protocol2, ResetRecords) {
  TrackedPoses poses = testing::playerPoses(2);
  poses.left = {1, 2, 3, 4, 5, 6, 7};
  poses.left_tracked = true;
  poses.left_inputs[3] = -0.5;
  poses.right_inputs[12] = 1.0;
  const auto reset = std::get<Reset>(decode(
      testing::message2(Type::reset, 2,
                        {testing::resetRecord(4, 9, -5, poses) +
                             testing::resetRecord(0, 4294967295U, 6, testing::playerPoses(1)),
                         R"([{"condition": "easy"}, {}])"})));
  ASSERT_EQ(reset.records.size(), 2U);
  EXPECT_EQ(reset.records[0].app, 4U);
  EXPECT_EQ(reset.records[0].seed, 9U);
  EXPECT_EQ(reset.records[0].time_ns, -5);
  EXPECT_EQ(reset.records[0].poses.head, poses.head);
  EXPECT_EQ(reset.records[0].poses.left, poses.left);
  EXPECT_EQ(reset.records[0].poses.right, poses.right);
  EXPECT_EQ(reset.records[0].poses.left_inputs, poses.left_inputs);
  EXPECT_EQ(reset.records[0].poses.right_inputs, poses.right_inputs);
  EXPECT_TRUE(reset.records[0].poses.left_tracked);
  EXPECT_EQ(reset.records[0].options_json, R"({"condition":"easy"})");
  EXPECT_EQ(reset.records[1].seed, 4294967295U);
  EXPECT_FALSE(reset.records[1].poses.left_tracked);
  EXPECT_EQ(reset.records[1].options_json, "{}");
}

TEST(Protocol2, StepRecordsShareOneFrameOfFrames) {
  const auto step = std::get<Step>(
      decode(testing::message2(Type::step, 2,
                               {testing::stepRecord(1, 2, 0) + testing::stepRecord(0, 1),
                                testing::stepFrame(10, testing::playerPoses(1)) +
                                    testing::stepFrame(20, testing::playerPoses(2)) +
                                    testing::stepFrame(30, testing::playerPoses(3))})));
  ASSERT_EQ(step.records.size(), 2U);
  EXPECT_EQ(step.records[0].app, 1U);
  EXPECT_EQ(step.records[0].drawn, 0);
  EXPECT_EQ(step.records[1].drawn, -1);
  ASSERT_EQ(step.records[0].frames.size(), 2U);
  EXPECT_EQ(step.records[0].frames[1].time_ns, 20);
  EXPECT_EQ(step.records[0].frames[1].poses.right, testing::playerPoses(2).right);
  ASSERT_EQ(step.records[1].frames.size(), 1U);
  EXPECT_EQ(step.records[1].frames[0].time_ns, 30);
}

TEST(Protocol2, RequestsAboutOneApp) {
  const auto picture = std::get<PictureRequest>(decode(
      testing::message2(Type::render, 0, {R"({"app": 2, "view": "recorder", "width": 8})"})));
  EXPECT_EQ(picture.app, 2U);
  EXPECT_EQ(picture.view, "recorder");
  EXPECT_EQ(picture.size, (render::ImageSize{8, 80}));
  EXPECT_EQ(std::get<Save>(decode(testing::message2(Type::save, 0, {testing::appIndex(3)}))).app,
            3U);
  EXPECT_EQ(std::get<Hash>(decode(testing::message2(Type::hash, 0, {testing::appIndex(4)}))).app,
            4U);
  const auto load =
      std::get<Load>(decode(testing::message2(Type::load, 0, {testing::appIndex(5), "state"})));
  EXPECT_EQ(load.app, 5U);
  EXPECT_EQ(load.state, "state");
  const auto head = std::get<HeadRequest>(decode(testing::message2(
      Type::head_request, 0, {R"({"app": 1, "seed": 4294967295, "options": {"a": 1}})"})));
  EXPECT_EQ(head.app, 1U);
  EXPECT_EQ(head.seed, 4294967295U);
  EXPECT_EQ(head.options_json, R"({"a":1})");
  EXPECT_TRUE(std::holds_alternative<Quit>(decode(testing::message2(Type::quit, 0, {}))));
}

TEST(Protocol2, MessagesThatCannotBe) {
  const std::string record = testing::resetRecord(0, 1, 0, testing::playerPoses(0));
  const std::string frame = testing::stepFrame(0, testing::playerPoses(0));
  const std::pair<Reply, const char*> messages[] = {
      {testing::message2(static_cast<Type>(11), 0, {}), "header type: got 11"},
      {testing::message2(Type::hello, 0, {}), "hello: got 1 frames, expected 2 with the header"},
      {testing::message2(Type::hello, 0, {"{}", "{}"}), "hello: got 3 frames"},
      {testing::message2(Type::hello, 0, {"hello"}), "hello: got no JSON"},
      {testing::message2(Type::hello, 0, {R"({"aps": 2})"}),
       "hello: got the unknown field 'aps', expected one of 15 names; did you mean 'apps'?"},
      {testing::message2(Type::hello, 0, {R"({"eyes": 3})"}), "hello.eyes: got 3"},
      {testing::message2(Type::hello, 0, {R"({"capabilities": "all"})"}),
       "hello.capabilities: got \"all\", expected an array"},
      {testing::message2(Type::hello, 0, {R"({"capabilities": ["a", 1]})"}),
       "hello.capabilities[1]: got 1, expected a string"},
      {testing::message2(Type::head_request, 0, {R"({"seed": -1})"}), "head_request.seed: got -1"},
      {testing::message2(Type::scene, 0, {R"({"meshes": -1})"}), "scene.meshes: got -1"},
      {testing::message2(Type::hello, 0, {R"({"apps": 0})"}), "hello.apps: got 0"},
      {testing::message2(Type::hello, 0, {R"({"apps": 1e9})"}), "hello.apps: got 1000000000.0"},
      {testing::message2(Type::reset, 2, {record, ""}),
       "reset records: got 400 bytes, expected 800 bytes"},
      {testing::message2(Type::reset, 4294967295U, {record, ""}), "reset records: got 400 bytes"},
      {testing::message2(Type::reset, 1, {record}), "reset: got 2 frames"},
      {testing::message2(Type::reset, 1, {record, "{}"}), "reset.options: got an object"},
      {testing::message2(Type::reset, 1, {record, "[1]"}), "reset.options[0]: got 1"},
      {testing::message2(Type::reset, 1, {record, "[{}, {}]"}), "reset.options: got 2 objects"},
      {testing::message2(Type::reset, 1, {record, R"([{}], "x": 1)"}), "reset: got the unknown f"},
      {testing::message2(Type::step, 1, {testing::stepRecord(0, 2), frame}),
       "step frames: got 392 bytes, expected 784 bytes"},
      {testing::message2(Type::step, 1, {testing::stepRecord(0, 4294967295U), frame}),
       "step frames: got 4294967295, expected 10000 at most"},
      {testing::message2(Type::step, 1, {testing::stepRecord(0, 1).substr(0, 15), frame}),
       "step records: got 15 bytes, expected 16 bytes"},
      {testing::message2(Type::save, 0, {"abc"}), "save app: got 3 bytes, expected 4 bytes"},
      {testing::message2(Type::render, 0, {R"({"width": 0})"}), "render.width: got 0"}};
  for (const auto& [message, text] : messages) {
    EXPECT_EQ(refusal(message).find(text), 0U) << text << "\n" << refusal(message);
  }
}

/// Two results: one with everything, one refused.
std::vector<Result> twoResults() {
  std::vector<Result> results(2);
  results[0].app = 3;
  results[0].step = {.reward = 0.5F,
                     .finished = true,
                     .time_feature = -0.25F,
                     .log = {{"a", 1.5}, {"b", 2.5}},
                     .events = {}};
  results[0].step.events.haptics = {{xr::Hand::right, 0.5F, 160.0F, 20'000'000},
                                    {xr::Hand::left, 1.0F, 0.0F, -1}};
  results[0].step.events.sounds = {{"hit", Vec3(0.25, -1.5, 2.0), 0.75F},
                                   {"miss", Vec3::Zero(), 1.0F},
                                   {"hit", Vec3::Zero(), 1.0F}};
  results[1].app = 1;
  results[1].status = Status::state_error;
  results[1].error = "the round is over";
  return results;
}

TEST(Protocol2, ResultRecords) {
  Names names;
  const Header request{.type = 3, .sequence = 8, .count = 77, .status = 5, .flags = 1};
  const Reply reply = encodeResults(request, twoResults(), names);
  ASSERT_EQ(reply.size(), 8U);
  const Header header = decodeHeader(reply[0]);
  EXPECT_EQ(header.type, 0x8003);
  EXPECT_EQ(header.sequence, 8U);
  EXPECT_EQ(header.count, 2U);
  EXPECT_EQ(header.status, 0U);
  EXPECT_EQ(header.flags, 0U);
  ASSERT_EQ(reply[1].size(), 2 * testing::kResultBytes);
  const auto number = [&reply](std::size_t record, std::size_t offset) {
    return testing::read<std::uint32_t>(reply[1], testing::kResultBytes * record + offset);
  };
  EXPECT_EQ(number(0, 0), 3U);
  EXPECT_EQ(number(0, 4), 1U);
  EXPECT_EQ(testing::read<float>(reply[1], 8), 0.5F);
  EXPECT_EQ(testing::read<float>(reply[1], 12), -0.25F);
  EXPECT_EQ(number(0, 16), 0U);
  EXPECT_EQ(number(0, 20), 2U);  // log values
  EXPECT_EQ(number(0, 24), 0U);  // id of their names
  EXPECT_EQ(number(0, 28), 2U);  // pulses
  EXPECT_EQ(number(0, 32), 3U);  // sounds
  EXPECT_EQ(number(1, 0), 1U);
  EXPECT_EQ(number(1, 16), 2U);
  EXPECT_EQ(number(1, 20), 0U);
  EXPECT_EQ(number(1, 28), 0U);
  EXPECT_EQ(testing::read<double>(reply[2], 0), 1.5);
  EXPECT_EQ(testing::read<double>(reply[2], 8), 2.5);
  EXPECT_EQ(reply[5], R"(["the round is over"])");
}

TEST(Protocol2, PulsesAndSoundsOfTheRecords) {
  Names names;
  const Reply reply = encodeResults({.type = 3}, twoResults(), names);
  ASSERT_EQ(reply[6].size(), 2 * 24U);
  EXPECT_EQ(testing::read<std::uint32_t>(reply[6], 0), 1U);  // right
  EXPECT_EQ(testing::read<float>(reply[6], 4), 0.5F);
  EXPECT_EQ(testing::read<float>(reply[6], 8), 160.0F);
  EXPECT_EQ(testing::read<std::int64_t>(reply[6], 16), 20'000'000);
  EXPECT_EQ(testing::read<std::uint32_t>(reply[6], 24), 0U);  // left
  EXPECT_EQ(testing::read<std::int64_t>(reply[6], 40), -1);
  ASSERT_EQ(reply[7].size(), 3 * 32U);
  EXPECT_EQ(testing::read<std::uint32_t>(reply[7], 0), 0U);
  EXPECT_EQ(testing::read<float>(reply[7], 4), 0.75F);
  EXPECT_EQ(testing::read<double>(reply[7], 8), 0.25);
  EXPECT_EQ(testing::read<double>(reply[7], 16), -1.5);
  EXPECT_EQ(testing::read<double>(reply[7], 24), 2.0);
  EXPECT_EQ(testing::read<std::uint32_t>(reply[7], 32), 1U);
  EXPECT_EQ(testing::read<std::uint32_t>(reply[7], 64), 0U);
}

TEST(Protocol2, NamesAreSentOnce) {
  Names names;
  EXPECT_EQ(Json::parse(encodeResults({.type = 3}, twoResults(), names)[3]),
            (Json{{"logs", {{"0", {"a", "b"}}, {"1", Json::array()}}},
                  {"sounds", {{"0", "hit"}, {"1", "miss"}}}}));
  EXPECT_EQ(encodeResults({.type = 3}, twoResults(), names)[3], "");
}

TEST(Protocol2, HeadRequests) {
  EXPECT_EQ(encodeHeadRequest(-10.5), R"({"pitch_deg":-10.5})");
  EXPECT_EQ(encodeHeadRequest(std::nullopt), R"({"pitch_deg":null})");
}

TEST(Protocol2, ErrorReplies) {
  const Reply reply =
      encodeError({.type = 2, .sequence = 6, .count = 3}, Status::busy, "busy \xff");
  ASSERT_EQ(reply.size(), 2U);
  const Header header = decodeHeader(reply[0]);
  EXPECT_EQ(header.type, 0x8002);
  EXPECT_EQ(header.sequence, 6U);
  EXPECT_EQ(header.count, 0U);
  EXPECT_EQ(header.status, 5U);
  EXPECT_EQ(reply[1], "busy \xEF\xBF\xBD");
}

}  // namespace
}  // namespace sim2vr::server::protocol2

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/server/protocol1.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "players.hpp"

namespace sim2vr::server::protocol1 {
namespace {

using testing::Json;

/// What decoding says about a message that it refuses.
template <class Decode>
std::string refusal(Decode decode, const std::string& text) {
  try {
    decode(text);
  } catch (const MalformedMessage& error) {
    return error.what();
  }
  return "accepted";
}

TEST(Protocol1, HandshakeOfUserInTheBox) {
  const Handshake handshake =
      decodeHandshake(R"({"timestep": 0.002, "sampleFrequency": 20, "timeScale": 5})");
  EXPECT_EQ(handshake.fixedStep_s(), 0.002);
  EXPECT_EQ(handshake.sample_frequency_hz, 20);
  EXPECT_EQ(handshake.time_scale, 5.0);
  EXPECT_FALSE(handshake.frame_time);
  EXPECT_FALSE(handshake.clock);
}

TEST(Protocol1, FixedDeltaTimeReplacesTheTimestep) {
  const Handshake handshake = decodeHandshake(
      R"({"timestep": 0.002, "sampleFrequency": 20, "timeScale": 1, "fixedDeltaTime": 0.01,
          "frameTime": "current", "clock": "round"})");
  EXPECT_EQ(handshake.fixedStep_s(), 0.01);
  EXPECT_EQ(handshake.frame_time, FrameTime::current);
  EXPECT_EQ(handshake.clock, ClockOrigin::round);
}

TEST(Protocol1, HandshakesThatCannotBe) {
  const std::pair<const char*, const char*> texts[] = {
      {"", "handshake: got no JSON"},
      {"[1]", "handshake: got an array, expected a JSON object"},
      {"{}", "handshake.sampleFrequency: got none or 0"},
      {R"({"sampleFrequency": 20, "timeScale": 1})", "handshake.timestep: got none or 0"},
      {R"({"sampleFrequency": 20, "timestep": 0.002})", "handshake.timeScale: got none or 0"},
      {R"({"sampleFrequency": "20"})", "handshake.sampleFrequency: got \"20\", expected a whole"},
      {R"({"sampleFrequency": 20.5})", "handshake.sampleFrequency: got 20.5, expected a whole"},
      {R"({"sampleFrequency": 1e300})", "handshake.sampleFrequency: got 1e+300"},
      {R"({"sampleFrequency": 20, "timestep": NaN})", "handshake: got no JSON (NaN"},
      {R"({"sampleFrequency": 20, "timestep": 1e999})", "handshake: got no JSON"},
      {R"({"sampleFrequency": 20, "timestep": 0.1, "timeScale": 1, "clock": "moon"})",
       "handshake.clock: got 'moon', expected 'absolute' or 'round'"}};
  for (const auto& [text, message] : texts) {
    EXPECT_EQ(refusal(decodeHandshake, text).find(message), 0U) << text << "\n"
                                                                << refusal(decodeHandshake, text);
  }
}

TEST(Protocol1, StateOfUserInTheBox) {
  const TrackedPoses poses = testing::playerPoses(3);
  const State state = decodeState(testing::stateJson(poses, 0.15, true).dump());
  EXPECT_EQ(state.poses.head, poses.head);
  EXPECT_EQ(state.poses.right, poses.right);
  EXPECT_TRUE(state.poses.right_tracked);
  EXPECT_FALSE(state.poses.left_tracked);
  EXPECT_EQ(state.current_s, 0.15);
  EXPECT_EQ(state.next_s, 0.15 + 0.05);
  EXPECT_TRUE(state.reset);
  EXPECT_FALSE(state.finished);
  EXPECT_FALSE(state.quit);
  EXPECT_FALSE(state.query_only);
}

TEST(Protocol1, ControllersAtTheOrigin) {
  Json message = testing::stateJson(testing::playerPoses(0), 0.0);
  testing::addPose(message, "rightController", {0, 0, 0, 0, 0, 0, 1});
  testing::addPose(message, "leftController", {0, 0, 0.5, 0, 0, 0, 1});
  State state = decodeState(message.dump());
  // A right controller at the origin is one; a left one is how the reference says that there is
  // none.
  EXPECT_TRUE(state.poses.right_tracked);
  EXPECT_TRUE(state.poses.left_tracked);
  message.erase("rightControllerPosition");
  message.erase("rightControllerRotation");
  message.erase("leftControllerPosition");
  message["leftControllerRotation"] = nullptr;
  state = decodeState(message.dump());
  EXPECT_FALSE(state.poses.right_tracked);
  EXPECT_FALSE(state.poses.left_tracked);
}

TEST(Protocol1, OurFieldsOfAState) {
  Json message = testing::stateJson(testing::playerPoses(0), 0.0, true);
  message["seed"] = 4294967295U;
  message["options"] = {{"condition", "easy"}};
  message["timeNs"] = 49'999'997;
  Json frame = testing::posesJson(testing::playerPoses(1));
  frame["time_ns"] = 10;
  message["frames"] = {frame, frame};
  message["stateHash"] = true;
  message["save"] = true;
  message["load"] = "Zm9v";
  message["render"] = {{"view", "spectator"}, {"width", 64}};
  const State state = decodeState(message.dump());
  EXPECT_EQ(state.seed, 4294967295U);
  EXPECT_EQ(state.options_json, R"({"condition":"easy"})");
  EXPECT_EQ(state.time_ns, 49'999'997);
  ASSERT_EQ(state.frames.size(), 2U);
  EXPECT_EQ(state.frames[1].time_ns, 10);
  EXPECT_EQ(state.frames[1].poses.head, testing::playerPoses(1).head);
  EXPECT_TRUE(state.wants_hash);
  EXPECT_TRUE(state.wants_save);
  EXPECT_EQ(state.load, "foo");
  ASSERT_TRUE(state.render);
  EXPECT_EQ(state.render->view, "spectator");
  EXPECT_EQ(state.render->size, (render::ImageSize{64, 80}));
  EXPECT_FALSE(state.query_only);
  EXPECT_TRUE(decodeState(R"({"stateHash": true})").query_only);
}

TEST(Protocol1, StatesThatCannotBe) {
  const std::pair<const char*, const char*> texts[] = {
      {R"({"headsetPosition": [1, 2, 3]})", "state.headsetPosition: got an array, expected an obj"},
      {R"({"headsetPosition": {"x": "1"}})", "state.headsetPosition.x: got \"1\", expected a numb"},
      {R"({"reset": 1})", "state.reset: got 1, expected true or false"},
      {R"({"seed": -1})", "state.seed: got -1, expected a whole number from 0 to 4294967295"},
      {R"({"seed": 18446744073709551615})", "state.seed: got 18446744073709551615"},
      {R"({"options": "easy"})", "state.options: got \"easy\", expected an object"},
      {R"({"frames": {}})", "state.frames: got an object, expected an array"},
      {R"({"frames": [1]})", "state.frames[0]: got 1, expected an object"},
      {R"({"frames": [{}, {"time_ns": 0.5}]})", "state.frames[1].time_ns: got 0.5"},
      {R"({"load": "Z"})", "base64: got 1 characters"},
      {R"({"render": {"width": 100000}})", "state.render.width: got 100000"},
      {"{\"options\": {\"a\": \"\xff\"}}", "state: got text that is not UTF-8"}};
  for (const auto& [text, message] : texts) {
    EXPECT_EQ(refusal(decodeState, text).find(message), 0U) << text << "\n"
                                                            << refusal(decodeState, text);
  }
}

TEST(Protocol1, NoMessageExhaustsStackOrMemory) {
  const std::string deep = R"({"options": )" + std::string(1'000'000, '[');
  EXPECT_EQ(refusal(decodeState, deep),
            "state: got JSON nested deeper, expected 32 levels at most");
  std::string wide = R"({"frames": [0)";
  for (int i = 0; i < 1'000'001; ++i) wide += ",0";
  EXPECT_EQ(refusal(decodeState, wide + "]}"),
            "state: got JSON with more values, expected 1000000 at most");
  // Brackets in a string are none.
  EXPECT_EQ(refusal(decodeState, R"({"other": ")" + std::string(100, '[') + R"(\"{"})"),
            "accepted");
}

TEST(Protocol1, ObservationHasTheReferencesFields) {
  Observation observation;
  observation.finished = true;
  observation.reward = 0.1F;
  observation.png = std::string("\x89PNG\x00\xff", 6);
  observation.time_feature = -1.0F;
  observation.log_json = logText({{"Points", 3.0},
                                  {"Rate", std::numeric_limits<double>::infinity()},
                                  {"Term", std::numeric_limits<double>::quiet_NaN()}});
  const std::string text = encodeObservation(observation);
  EXPECT_EQ(text, R"({"isFinished":true,"reward":0.10000000149011612,"image":[137,80,78,71,0,255],)"
                  R"("timeFeature":-1.0,"logDict":"{\"Points\":3.0}"})");
  EXPECT_EQ(static_cast<float>(Json::parse(text)["reward"].get<double>()), 0.1F);
}

TEST(Protocol1, ObservationWithOurFields) {
  Observation observation;
  observation.state_hash = 0xABCDU;
  observation.saved_state = "foo";
  observation.picture_png = "A";
  observation.error_code = "state_error";
  observation.error_message = "not \"now\" \xff";
  const Json json = Json::parse(encodeObservation(observation));
  EXPECT_EQ(json["image"], Json::array());
  EXPECT_EQ(json["stateHash"], "000000000000abcd");
  EXPECT_EQ(json["state"], "Zm9v");
  EXPECT_EQ(json["render"], Json::array({65}));
  EXPECT_EQ(json["error"]["code"], "state_error");
  EXPECT_EQ(json["error"]["message"], "not \"now\" \xEF\xBF\xBD");
}

}  // namespace
}  // namespace sim2vr::server::protocol1

// SPDX-License-Identifier: Apache-2.0
// What arrives over the socket, and what may not.
#include "harness.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <limits>

namespace sim2vr::openxr {
namespace {

std::string reason(const std::function<void()>& work) {
  try {
    work();
  } catch (const wire::MalformedMessage& error) {
    return error.what();
  }
  return "accepted";
}

std::string step(std::uint32_t count, std::int64_t time, double head_w = 1.0, double button = 0.0) {
  std::string body;
  wire::append(body, count);
  wire::append(body, time);
  for (int i = 0; i < 7; ++i) wire::append(body, i == 6 ? head_w : 0.0);
  body += std::string("\0\1", 2);
  for (int i = 0; i < 14; ++i) wire::append(body, i % 7 == 6 ? 1.0 : 0.0);
  for (int i = 0; i < 26; ++i) wire::append(body, i == 13 + 4 ? button : 0.0);
  return body + '\1';
}

TEST(Messages, AStepIsDecoded) {
  const Step decoded = decodeStep(step(1, 77, 1.0, 1.0));
  ASSERT_EQ(decoded.frames.size(), 1U);
  EXPECT_EQ(decoded.frames[0].time, 77);
  EXPECT_FALSE(decoded.frames[0].devices.hands[0].active);
  EXPECT_TRUE(decoded.frames[0].devices.hands[1].active);
  EXPECT_TRUE(decoded.frames[0].devices.hands[1].thumbstick_click);
  EXPECT_TRUE(decoded.image_wanted);
}

TEST(Messages, WrongStepsAreNamed) {
  EXPECT_EQ(reason([] { decodeStep(""); }), "message: a frame ends too early");
  EXPECT_EQ(reason([] { decodeStep(step(0, 1)); }), "step.frames: got 0, expected 1 to 1000");
  EXPECT_EQ(reason([] { decodeStep(step(1001, 1)); }), "step.frames: got 1001, expected 1 to 1000");
  EXPECT_EQ(reason([] { decodeStep(step(2, 1)); }),
            "step: got 391 bytes, expected 777 for 2 frames");
  EXPECT_EQ(reason([] { decodeStep(step(1, 0)); }),
            "step.frames[0].time: got 0 ns, expected above 0 and up to 1000000000000000000");
  EXPECT_NE(reason([] { decodeStep(step(1, 1, 0.5)); }).find("head.rotation"), std::string::npos);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(reason([&] { decodeStep(step(1, 1, nan)); }).find("head.rotation"), std::string::npos);
  EXPECT_NE(reason([] { decodeStep(step(1, 1, 1.0, 0.5)); }).find("thumbstick_click"),
            std::string::npos);
}

TEST(Messages, AConfigurationHasBounds) {
  const Config config = decodeConfig(R"({"width": 60, "height": 40, "hands": ["right"]})");
  EXPECT_EQ(config.eyeBytes(), 9600U);
  EXPECT_FALSE(config.left_hand);
  EXPECT_TRUE(config.right_hand);
  for (const char* wrong :
       {"[]", "{", R"({"width": 0})", R"({"width": 5000})", R"({"gate": "open"})",
        R"({"hands": ["third"]})", R"({"timeout_s": 0})", R"({"frame_rate_hz": 1e9})",
        R"({"vertical_fov_deg": 180})", R"({"images": 1})"}) {
    EXPECT_NE(reason([&] { decodeConfig(wrong); }), "accepted") << wrong;
  }
}

TEST(Messages, ErrorsOfTheHarnessAreReadHoweverTheyAreWritten) {
  EXPECT_EQ(decodeError(R"({"error": "no depth"})"), "no depth");
  EXPECT_EQ(decodeError("no JSON"), "no JSON");
}

}  // namespace
}  // namespace sim2vr::openxr

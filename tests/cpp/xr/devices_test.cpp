// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <limits>

#include "sim2vr/xr/scripted_device.hpp"
#include "support.hpp"

namespace sim2vr::xr {
namespace {

TEST(Validated, RotationsAreNormalised) {
  DeviceState state;
  state.head.orientation.w = 1.0009F;
  EXPECT_EQ(validated(state).head.orientation.w, 1.0F);
}

TEST(Validated, RefusesWhatIsNoPoseByItsName) {
  const auto error = [](const std::function<void(DeviceState&)>& change) {
    DeviceState state;
    state.hand(Hand::right) = activeController();
    change(state);
    return errorOf<InvalidArgument>([&] { validated(state); });
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(
      error([](DeviceState& s) { s.hand(Hand::right).grip.orientation.w = 1.002F; }),
      "right_controller.rotation: got (0.000000, 0.000000, 0.000000, 1.002000), expected a unit "
      "quaternion x y z w (length 1 within 0.001)");
  EXPECT_EQ(error([&](DeviceState& s) { s.head.position.z = nan; }),
            "head.position: got a number that is not finite, expected metres");
  EXPECT_EQ(error([&](DeviceState& s) { s.head.orientation.x = nan; }).substr(0, 13),
            "head.rotation");
  EXPECT_EQ(
      error([](DeviceState& s) { s.hand(Hand::right).aim.orientation.w = 0.0F; }).substr(0, 29),
      "right_controller.aim_rotation");
  EXPECT_EQ(error([](DeviceState& s) { s.hand(Hand::right).trigger = 1.5F; }),
            "right_controller.trigger: got 1.500000, expected a number from 0 to 1");
  EXPECT_EQ(error([](DeviceState& s) { s.hand(Hand::right).thumbstick.y = -1.5F; }),
            "right_controller.thumbstick.y: got -1.500000, expected a number from -1 to 1");
}

TEST(Validated, OfAnInactiveControllerNothingIsCheckedAndNothingKept) {
  DeviceState state;
  state.hand(Hand::left).grip.orientation = {0, 0, 0, 0};
  state.hand(Hand::left).trigger = 0.5F;
  const ControllerState left = validated(state).hand(Hand::left);
  EXPECT_EQ(left.trigger, 0.0F);
  EXPECT_EQ(left.grip.orientation.w, 1.0F);
}

TEST(Poses, ComposeAndInverse) {
  const float half = std::sqrt(0.5F);
  const XrPosef a{{0, half, 0, half}, {1, 2, 3}};  // +90 degrees about y: z to x
  const XrPosef b{{0, 0, 0, 1}, {0, 0, 1}};
  expectPose(compose(a, b), {{0, half, 0, half}, {2, 2, 3}});
  expectPose(compose(a, inverse(a)), kIdentityPose);
  expectPose(compose(inverse(a), a), kIdentityPose);
}

// Of a controller held upright in front, the Touch aim ray points 60 degrees below the grip's -z.
TEST(Poses, GripToAim) {
  const XrPosef ray{{0, 0, 0, 1}, {0, 0, -1}};
  const XrPosef tip = compose(kGripToAim, ray);
  EXPECT_NEAR(tip.position.y, -std::sqrt(0.75F), 1e-6);
  EXPECT_NEAR(tip.position.z, -0.5F, 1e-6);
}

constexpr const char* kScript = R"({"keyframes": [
  {"time_s": 0.0, "head": {"position": [0, 1.6, 0]},
   "right_controller": {"position": [0, 1, 0], "trigger": 0.0}},
  {"time_s": 1.0,
   "right_controller": {"position": [2, 1, -4], "rotation": [0, 0.70710678, 0, 0.70710678],
                        "trigger": 1.0, "a": true}},
  {"time_s": 3.0, "right_controller": {"active": false}}
]})";

TEST(ScriptedDevice, InterpolatesPosesAndHoldsButtons) {
  const ScriptedDevice device = ScriptedDevice::fromJson(kScript);
  EXPECT_FLOAT_EQ(device.sample(-1).hand(Hand::right).grip.position.x, 0.0F) << "its start";
  const ControllerState quarter = device.sample(250'000'000).hand(Hand::right);
  EXPECT_TRUE(quarter.active);
  EXPECT_FLOAT_EQ(quarter.grip.position.x, 0.5F);
  EXPECT_FLOAT_EQ(quarter.grip.position.z, -1.0F);
  EXPECT_FLOAT_EQ(quarter.trigger, 0.25F);
  EXPECT_FALSE(quarter.a);
  // A quarter of 90 degrees: half the angle is 11.25 degrees.
  EXPECT_NEAR(quarter.grip.orientation.y, 0.19509032F, 1e-6);
  EXPECT_FLOAT_EQ(device.sample(250'000'000).head.position.y, 1.6F) << "kept from before";
  EXPECT_TRUE(device.sample(1'000'000'000).hand(Hand::right).a);
  const ControllerState held = device.sample(2'000'000'000).hand(Hand::right);
  EXPECT_TRUE(held.active) << "active until the keyframe that says otherwise";
  EXPECT_FLOAT_EQ(held.grip.position.x, 2.0F);
  EXPECT_FALSE(device.sample(3'000'000'000).hand(Hand::right).active);
  EXPECT_FALSE(device.sample(99'000'000'000).hand(Hand::right).active) << "its end";
}

TEST(ScriptedDevice, AimFollowsTheGripUnlessGiven) {
  const ScriptedDevice device = ScriptedDevice::fromJson(kScript);
  const ControllerState start = device.sample(0).hand(Hand::right);
  expectPose(start.aim, compose(start.grip, kGripToAim));
  const ScriptedDevice given = ScriptedDevice::fromJson(
      R"({"keyframes": [{"time_s": 0, "left_controller": {"aim_position": [1, 2, 3]}}]})");
  EXPECT_FLOAT_EQ(given.sample(0).hand(Hand::left).aim.position.z, 3.0F);
}

TEST(ScriptedDevice, ErrorsNameTheEntry) {
  const auto error = [](const char* text) {
    return errorOf<InvalidArgument>([&] { ScriptedDevice::fromJson(text); });
  };
  EXPECT_EQ(error("{"), "script: got '{', expected a JSON object");
  EXPECT_EQ(error("{}"), "keyframes: got none, expected a list of keyframes");
  EXPECT_EQ(error(R"({"keyframes": []})"), "keyframes: got none, expected one keyframe or more");
  EXPECT_EQ(error(R"({"keyframes": [{}]})"), "keyframes[0].time_s: got nothing, expected seconds");
  EXPECT_EQ(error(R"({"keyframes": [{"time_s": -1}]})"),
            "keyframes[0].time_s: got -1, expected seconds from 0 to below 1e9");
  EXPECT_EQ(error(R"({"keyframes": [{"time_s": 0, "head": {"position": [1, 2]}}]})"),
            "keyframes[0].head.position: got [1,2], expected a list of 3 numbers");
  EXPECT_EQ(
      error(R"({"keyframes": [{"time_s": 0, "right_controler": {}}]})"),
      "keyframes[0]: got 'right_controler', expected only 'time_s', 'head', 'left_controller' "
      "or 'right_controller'; did you mean 'right_controller'?");
  EXPECT_EQ(error(R"({"keyframes": [{"time_s": 1}, {"time_s": 1}]})"),
            "keyframes[1].time: got 1000000000 ns, expected a time after the previous keyframe's "
            "1000000000 ns");
  EXPECT_EQ(error(R"({"keyframes": [{"time_s": 0, "left_controller": {"trigger": 2}}]})"),
            "left_controller.trigger: got 2.000000, expected a number from 0 to 1");
}

}  // namespace
}  // namespace sim2vr::xr

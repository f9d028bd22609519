// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/server/message.hpp"

#include <gtest/gtest.h>

#include "players.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::server {
namespace {

std::string refusal(const auto& call) {
  try {
    call();
  } catch (const InvalidArgument& error) {
    return error.what();
  }
  return "accepted";
}

TEST(TrackedPoses, InputsOfTrackedControllersReachTheApp) {
  TrackedPoses poses = testing::playerPoses(0);
  poses.right_inputs[0] = 0.25;
  poses.right_inputs[5] = 1.0;
  poses.left_inputs[7] = 1.0;  // not tracked: means nothing
  xr::DeviceState devices = poses.devices();
  EXPECT_EQ(devices.hand(xr::Hand::right).trigger, 0.25F);
  EXPECT_TRUE(devices.hand(xr::Hand::right).a);
  EXPECT_FALSE(devices.hand(xr::Hand::left).menu);
  poses.left = poses.right;
  poses.left_tracked = true;
  EXPECT_TRUE(poses.devices().hand(xr::Hand::left).menu);
  poses.left_inputs[7] = 0.5;
  EXPECT_EQ(refusal([&] { poses.devices(); }), "left_controller.menu: got 0.5, expected 0 or 1");
}

TEST(GameTime, IsWhatASavedStateCanHold) {
  EXPECT_NO_THROW(checkGameTime(0));
  EXPECT_NO_THROW(checkGameTime(kLatest_ns));
  EXPECT_EQ(refusal([] { checkGameTime(kLatest_ns + 1); }),
            "time_ns: got 1000000000000000001, expected 0 to 1000000000000000000");
  EXPECT_THROW(checkGameTime(-1), InvalidArgument);
}

}  // namespace
}  // namespace sim2vr::server

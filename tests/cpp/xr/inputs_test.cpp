// SPDX-License-Identifier: Apache-2.0
// Rows of controller inputs (pose_row.hpp).
#include <array>
#include <limits>

#include "sim2vr/xr/pose_row.hpp"
#include "support.hpp"

namespace sim2vr::xr {
namespace {

using Row = std::array<double, kInputRowNumbers>;

TEST(InputRow, EveryColumnBecomesItsInput) {
  const Row row{0.25, 0.5, -1.0, 1.0, 1, 1, 0, 0, 1, 0, 1, 0, 1};
  const ControllerState right = inputsFromRow(Hand::right, row.data());
  EXPECT_EQ(right.trigger, 0.25F);
  EXPECT_EQ(right.squeeze, 0.5F);
  EXPECT_EQ(right.thumbstick.x, -1.0F);
  EXPECT_EQ(right.thumbstick.y, 1.0F);
  EXPECT_TRUE(right.thumbstick_click && right.a && right.trigger_touch && right.lower_touch &&
              right.thumbrest_touch);
  EXPECT_FALSE(right.b || right.x || right.y || right.menu || right.thumbstick_touch ||
               right.upper_touch);
  const ControllerState left = inputsFromRow(Hand::left, row.data());
  EXPECT_TRUE(left.x);
  EXPECT_FALSE(left.a || left.y);
}

TEST(InputRow, RefusesWhatIsNoButtonByItsName) {
  Row row{};
  row[5] = 0.5;
  EXPECT_EQ(errorOf<InvalidArgument>([&] { inputsFromRow(Hand::left, row.data()); }),
            "left_controller.x: got 0.5, expected 0 or 1");
  row[5] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(errorOf<InvalidArgument>([&] { inputsFromRow(Hand::right, row.data()); }),
            "right_controller.a: got nan, expected 0 or 1");
  row[5] = 0.0;
  row[7] = 1.0;
  EXPECT_EQ(errorOf<InvalidArgument>([&] { inputsFromRow(Hand::right, row.data()); }),
            "right_controller.menu: got 1, expected 0: the right controller has none");
}

TEST(InputRow, ReachesTheDeviceStateOfATrackedControllerOnly) {
  const std::array<double, kPoseRowNumbers> pose{0, 1, 0, 0, 0, 0, 1};
  Row row{};
  row[0] = 0.75;
  const std::array<ControllerState, 2> inputs{inputsFromRow(Hand::left, row.data()),
                                              inputsFromRow(Hand::right, row.data())};
  const DeviceState state = devicesFromRows(pose.data(), nullptr, pose.data(), inputs);
  EXPECT_EQ(state.hand(Hand::right).trigger, 0.75F);
  EXPECT_FALSE(state.hand(Hand::left).active);
  EXPECT_EQ(state.hand(Hand::left).trigger, 0.0F);
}

}  // namespace
}  // namespace sim2vr::xr

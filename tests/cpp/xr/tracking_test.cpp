// SPDX-License-Identifier: Apache-2.0
// Where spaces are, for our own games and for OpenXR programs alike.
#include "sim2vr/xr/tracking.hpp"

#include <cmath>
#include <numbers>

#include "support.hpp"

namespace sim2vr::xr {
namespace {

const float kHalf = std::sqrt(0.5F);
const XrQuaternionf kNoTurn{0, 0, 0, 1};
const XrQuaternionf kLeftTurn{0, kHalf, 0, kHalf};  // +90 degrees about y: forward -z to -x

Space reference(XrReferenceSpaceType type, const XrPosef& offset = kIdentityPose) {
  return {.reference = type, .offset = offset};
}
const Space kStage = reference(XR_REFERENCE_SPACE_TYPE_STAGE);
const Space kView = reference(XR_REFERENCE_SPACE_TYPE_VIEW);
const Space kLocal = reference(XR_REFERENCE_SPACE_TYPE_LOCAL);

/// Head and right hand in the first frame, at 100 ns.
class Spaces : public ::testing::Test {
 protected:
  Spaces() {
    frame_.devices.head = {kLeftTurn, {0.2F, 1.6F, -0.3F}};
    ControllerState& right = frame_.devices.hand(Hand::right);
    right.active = true;
    right.grip = {kNoTurn, {0.5F, 1.0F, -0.5F}};
    right.aim = {kLeftTurn, {0.5F, 1.1F, -0.5F}};
    tracking_.track(frame_);
    bind(grip_, "/user/hand/left/input/grip/pose");
    bind(grip_, "/user/hand/right/input/grip/pose");
    bind(aim_, "/user/hand/right/input/aim/pose");
    sync();
  }

  void bind(Action& action, const char* path) {
    action.type = XR_ACTION_TYPE_POSE_INPUT;
    action.set = &set_;
    action.bind(*findProfile("/interaction_profiles/oculus/touch_controller")->find(path));
  }

  void sync() {
    Action* const actions[]{&grip_, &aim_};
    const ActiveSet active[]{{&set_}};
    syncActions(actions, active, &frame_.devices, frame_.time);
  }

  static Space actionSpace(const Action& action, Hand hand) {
    return {.action = &action, .hand = static_cast<std::size_t>(hand)};
  }

  XrPosef pose(const Space& space, const Space& base = kStage, XrTime time = 100) const {
    const auto found = tracking_.locate(space, base, time);
    EXPECT_TRUE(found.has_value());
    return found.value_or(Motion{}).pose;
  }

  Frame frame_{.time = 100, .devices = {}};
  Tracking tracking_{32};
  ActionSet set_{.name = "play"};
  Action grip_;
  Action aim_;
};

TEST_F(Spaces, HeadAndHandsInStage) {
  expectPose(pose(kView), {kLeftTurn, {0.2F, 1.6F, -0.3F}});
  const XrPosef grip = pose(actionSpace(grip_, Hand::right));
  EXPECT_EQ(grip.position.x, 0.5F) << "the very bits that were tracked";
  EXPECT_EQ(grip.orientation.w, 1.0F);
  expectPose(pose(actionSpace(aim_, Hand::right)), {kLeftTurn, {0.5F, 1.1F, -0.5F}});
}

TEST_F(Spaces, AnInactiveActionHasNoPlace) {
  const Space left = actionSpace(grip_, Hand::left);
  EXPECT_FALSE(tracking_.locate(left, kStage, 100));
  EXPECT_FALSE(tracking_.locate(kStage, left, 100));
  const Space right = actionSpace(grip_, Hand::right);
  frame_.devices.hand(Hand::right).active = false;
  sync();
  EXPECT_FALSE(tracking_.locate(right, kStage, 100));
}

// Seen from a head turned to the left at (0.2, 1.6, -0.3): the hand at (0.5, 1.0, -0.5) is 0.3 to
// the world's right, that is behind the head (+z), 0.2 to the world's front, that is to its right.
TEST_F(Spaces, HandSeenFromTheHead) {
  expectPose(pose(actionSpace(grip_, Hand::right), kView),
             {{0, -kHalf, 0, kHalf}, {0.2F, -0.6F, 0.3F}});
}

TEST_F(Spaces, OffsetsMoveSpaces) {
  expectPose(pose(reference(XR_REFERENCE_SPACE_TYPE_VIEW, {kNoTurn, {0, 0, -1}}),
                  reference(XR_REFERENCE_SPACE_TYPE_STAGE, {kNoTurn, {0, 1, 0}})),
             {kLeftTurn, {0.2F - 1.0F, 0.6F, -0.3F}});
}

// The specification's LOCAL: where the head was at first, at its height, turned by its yaw alone.
TEST_F(Spaces, LocalIsWhereTheHeadWasInTheFirstFrame) {
  expectPose(pose(kLocal), {kLeftTurn, {0.2F, 1.6F, -0.3F}});
  expectPose(pose(reference(kLocalFloor)), {kLeftTurn, {0.2F, 0.0F, -0.3F}});
  frame_.time = 200;
  frame_.devices.head = {kNoTurn, {0, 1.2F, 0}};
  tracking_.track(frame_);
  expectPose(pose(kLocal, kStage, 200), {kLeftTurn, {0.2F, 1.6F, -0.3F}});
  // A head that looks down by 60 degrees has no yaw.
  Tracking down(1);
  frame_.devices.head.orientation = {-0.5F, 0, 0, std::sqrt(0.75F)};
  down.track(frame_);
  expectPose(down.locate(kLocal, 200)->pose, {kNoTurn, {0, 1.2F, 0}});
}

TEST_F(Spaces, EyesAreHalfAnIpdToEitherSide) {
  // The head looks along -x, so that its right is the world's -z.
  expectPose(pose(eyeSpace(0, 0.064)), {kLeftTurn, {0.2F, 1.6F, -0.3F + 0.032F}});
  expectPose(pose(eyeSpace(1, 0.064)), {kLeftTurn, {0.2F, 1.6F, -0.3F - 0.032F}});
  const XrFovf fov = eyeFov(90.0, 1.5);
  EXPECT_FLOAT_EQ(fov.angleUp, std::numbers::pi_v<float> / 4);
  EXPECT_FLOAT_EQ(fov.angleDown, -std::numbers::pi_v<float> / 4);
  EXPECT_FLOAT_EQ(fov.angleRight, std::atan(1.5F));
  EXPECT_FLOAT_EQ(fov.angleLeft, -std::atan(1.5F));
}

TEST_F(Spaces, BetweenFramesPosesAndVelocitiesAreInterpolated) {
  // 100 ns later the head is 2 um further along x and turned back by 90 degrees.
  frame_.time = 200;
  frame_.devices.head = {kNoTurn, {2.2F, 1.6F, -0.3F}};
  tracking_.track(frame_);
  const Motion half = *tracking_.locate(kView, 150);
  expectPose(half.pose, {{0, std::sin(0.3926991F), 0, std::cos(0.3926991F)}, {1.2F, 1.6F, -0.3F}});
  EXPECT_NEAR(half.linear.x * 1e-7F, 2.0F, 1e-5F);
  EXPECT_NEAR(half.angular.y * 1e-7F, -std::numbers::pi_v<float> / 2, 1e-5F);
  expectPose(pose(kView, kStage, 50), {kLeftTurn, {0.2F, 1.6F, -0.3F}});
  expectPose(pose(kView, kStage, 999), {kNoTurn, {2.2F, 1.6F, -0.3F}});
}

TEST_F(Spaces, SavedFramesComeBackAndTooManyAreRefused) {
  frame_.time = 200;
  tracking_.track(frame_);
  Archive saved = Archive::saver();
  tracking_.fields(saved);
  Tracking fresh(2);
  Archive loader = Archive::loader(saved.bytes());
  fresh.fields(loader);
  EXPECT_EQ(fresh.latest()->time, 200);
  expectPose(fresh.locate(kLocal, 200)->pose, {kLeftTurn, {0.2F, 1.6F, -0.3F}});
  Tracking small(1);
  Archive again = Archive::loader(saved.bytes());
  EXPECT_EQ(errorOf<EngineError>([&] { small.fields(again); }),
            "saved state: field 'frames': got 2, expected up to 1");
}

}  // namespace
}  // namespace sim2vr::xr

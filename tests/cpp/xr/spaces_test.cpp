#include <cmath>
#include <numbers>

#include "support.hpp"

namespace sim2vr::xr {
namespace {

const float kHalf = std::sqrt(0.5F);
const XrQuaternionf kNoTurn{0, 0, 0, 1};
const XrQuaternionf kLeftTurn{0, kHalf, 0, kHalf};  // +90 degrees about y: forward -z to -x

class Spaces : public ::testing::Test {
 protected:
  Spaces() {
    grip_ = &set_.createAction("grip", XR_ACTION_TYPE_POSE_INPUT, {Hand::left, Hand::right});
    aim_ = &set_.createAction("aim", XR_ACTION_TYPE_POSE_INPUT, {Hand::right});
    session_.suggestBinding(*grip_, "/user/hand/left/input/grip/pose");
    session_.suggestBinding(*grip_, "/user/hand/right/input/grip/pose");
    session_.suggestBinding(*aim_, "/user/hand/right/input/aim/pose");
    session_.attachActionSets();
    device_.setHead({kLeftTurn, {0.2F, 1.6F, -0.3F}});
    ControllerState right = activeController();
    right.grip = {kNoTurn, {0.5F, 1.0F, -0.5F}};
    right.aim = {kLeftTurn, {0.5F, 1.1F, -0.5F}};
    device_.setController(Hand::right, right);
    session_.begin();
    session_.waitFrame(100, kPeriod);
    session_.syncActions();
  }

  Space reference(XrReferenceSpaceType type) { return session_.referenceSpace(type); }

  SimulatedDevice device_;
  Session session_{device_};
  ActionSet& set_ = session_.createActionSet("play");
  Action* grip_ = nullptr;
  Action* aim_ = nullptr;
};

constexpr XrSpaceLocationFlags kAllFlags = 0xF;

TEST_F(Spaces, HeadAndHandsInStage) {
  const Space stage = reference(XR_REFERENCE_SPACE_TYPE_STAGE);
  const auto head = session_.locateSpace(reference(XR_REFERENCE_SPACE_TYPE_VIEW), stage, 100);
  EXPECT_EQ(head.type, XR_TYPE_SPACE_LOCATION);
  EXPECT_EQ(head.locationFlags, kAllFlags);
  expectPose(head.pose, {kLeftTurn, {0.2F, 1.6F, -0.3F}});
  const auto grip = session_.locateSpace(session_.actionSpace(*grip_, Hand::right), stage, 100);
  EXPECT_EQ(grip.pose.position.x, 0.5F) << "the very bits that were set";
  EXPECT_EQ(grip.pose.orientation.w, 1.0F);
  const auto aim = session_.locateSpace(session_.actionSpace(*aim_, Hand::right), stage, 100);
  expectPose(aim.pose, {kLeftTurn, {0.5F, 1.1F, -0.5F}});
}

TEST_F(Spaces, InactiveHandHasNoPlace) {
  const Space left = session_.actionSpace(*grip_, Hand::left);
  const auto place = session_.locateSpace(left, reference(XR_REFERENCE_SPACE_TYPE_STAGE), 100);
  EXPECT_EQ(place.locationFlags, 0U);
  expectPose(place.pose, kIdentityPose);
  const auto back = session_.locateSpace(reference(XR_REFERENCE_SPACE_TYPE_STAGE), left, 100);
  EXPECT_EQ(back.locationFlags, 0U);
}

// Seen from a head turned to the left at (0.2, 1.6, -0.3): the hand at (0.5, 1.0, -0.5) is 0.3 to
// the world's right, that is behind the head (+z), 0.2 to the world's front, that is to its right.
TEST_F(Spaces, HandSeenFromTheHead) {
  const auto place = session_.locateSpace(session_.actionSpace(*grip_, Hand::right),
                                          reference(XR_REFERENCE_SPACE_TYPE_VIEW), 100);
  expectPose(place.pose, {{0, -kHalf, 0, kHalf}, {0.2F, -0.6F, 0.3F}});
}

TEST_F(Spaces, OffsetsMoveSpaces) {
  const XrPosef ahead{kNoTurn, {0, 0, -1}};
  const auto place = session_.locateSpace(
      session_.referenceSpace(XR_REFERENCE_SPACE_TYPE_VIEW, ahead),
      session_.referenceSpace(XR_REFERENCE_SPACE_TYPE_STAGE, {kNoTurn, {0, 1, 0}}), 100);
  expectPose(place.pose, {kLeftTurn, {0.2F - 1.0F, 0.6F, -0.3F}});
}

TEST_F(Spaces, LocalIsAtTheHeadsHeightAndYawOfTheFirstFrame) {
  const auto local = [&] {
    return session_
        .locateSpace(reference(XR_REFERENCE_SPACE_TYPE_LOCAL),
                     reference(XR_REFERENCE_SPACE_TYPE_STAGE), session_.frameTime())
        .pose;
  };
  expectPose(local(), {kLeftTurn, {0, 1.6F, 0}});
  session_.beginFrame();
  session_.endFrame();
  // The head tilts down by 60 degrees, without yaw, and sinks: LOCAL stays until recentred.
  device_.setHead({{-0.5F, 0, 0, std::sqrt(0.75F)}, {0, 1.2F, 0}});
  session_.waitFrame(200, kPeriod);
  expectPose(local(), {kLeftTurn, {0, 1.6F, 0}});
  session_.recenter();
  expectPose(local(), {kNoTurn, {0, 1.2F, 0}});
}

TEST_F(Spaces, ViewsAreHalfAnIpdToEitherSide) {
  const auto views = session_.locateViews(100, reference(XR_REFERENCE_SPACE_TYPE_STAGE));
  ASSERT_EQ(views.size(), 2U);
  // The head looks along -x, so that its right is the world's -z.
  expectPose(views[0].pose, {kLeftTurn, {0.2F, 1.6F, -0.3F + 0.032F}});
  expectPose(views[1].pose, {kLeftTurn, {0.2F, 1.6F, -0.3F - 0.032F}});
  EXPECT_FLOAT_EQ(views[0].fov.angleUp, std::numbers::pi_v<float> / 4);
  EXPECT_FLOAT_EQ(views[0].fov.angleDown, -std::numbers::pi_v<float> / 4);
  EXPECT_FLOAT_EQ(views[0].fov.angleRight, std::atan(1.5F));
  EXPECT_FLOAT_EQ(views[1].fov.angleLeft, -std::atan(1.5F));
}

TEST_F(Spaces, PosesOfTheFrameStayWhileTheDeviceMovesOn) {
  const Space view = reference(XR_REFERENCE_SPACE_TYPE_VIEW);
  const Space stage = reference(XR_REFERENCE_SPACE_TYPE_STAGE);
  device_.setHead({kNoTurn, {0, 1.8F, 0}});
  EXPECT_EQ(session_.locateSpace(view, stage, 100).pose.position.y, 1.6F);
  EXPECT_EQ(session_.locateSpace(view, stage, 150).pose.position.y, 1.8F) << "asked anew";
  session_.beginFrame();
  session_.endFrame();
  session_.waitFrame(200, kPeriod);
  EXPECT_EQ(session_.locateSpace(view, stage, 200).pose.position.y, 1.8F);
}

TEST_F(Spaces, WrongSpacesAreRefused) {
  EXPECT_EQ(errorOf<InvalidArgument>([&] { reference(XR_REFERENCE_SPACE_TYPE_MAX_ENUM); }),
            "reference space type: got 2147483647, expected VIEW, LOCAL or STAGE");
  EXPECT_EQ(
      errorOf<InvalidArgument>([&] { session_.actionSpace(*aim_, Hand::left); }),
      "action 'aim': got a request for an action space, expected a pose action that was created "
      "with this hand");
}

}  // namespace
}  // namespace sim2vr::xr

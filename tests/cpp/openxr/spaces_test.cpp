// SPDX-License-Identifier: Apache-2.0
// Spaces, velocities and views, with numbers of the steps that FakeHarness sends: in the app's
// frame the head is at (n, 1.6, 0) and the right hand at (0.2, 1.0, 0.5 + 0.1 n) in frame n, every
// 10 ms.
#include <cmath>

#include "calls.hpp"
#include "program.hpp"

namespace sim2vr::openxr::test {
namespace {

struct Spaces : ::testing::Test {
  FakeHarness harness;
  Program program;
  XrFrameState state{};

  void start(XrVersion version = kVersion10) {
    harness.sendConfig();
    ASSERT_EQ(program.create({"XR_MND_headless"}, version), XR_SUCCESS);
    harness.send(MessageKind::accepted);
    ASSERT_EQ(program.createSession(), XR_SUCCESS);
    ASSERT_EQ(program.begin(), XR_SUCCESS);
  }
  void frames(int count) {
    for (int i = 0; i < count; ++i) {
      harness.sendStep();
      ASSERT_EQ(program.frame(&state), XR_SUCCESS);
    }
  }
  XrSpaceLocation locate(XrSpace space, XrSpace base, XrSpaceVelocity* velocity = nullptr,
                         XrTime earlier = 0) {
    XrSpaceLocation location{XR_TYPE_SPACE_LOCATION, velocity, 0, {}};
    if (velocity != nullptr) velocity->type = XR_TYPE_SPACE_VELOCITY;
    EXPECT_EQ(XR_CALL(program.instance, xrLocateSpace)(
                  space, base, state.predictedDisplayTime - earlier, &location),
              XR_SUCCESS);
    return location;
  }
};

TEST_F(Spaces, ViewMovesInStageWithItsVelocity) {
  start();
  frames(3);
  const XrSpace view = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_VIEW);
  const XrSpace stage = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_STAGE);
  XrSpaceVelocity velocity{};
  const XrSpaceLocation here = locate(view, stage, &velocity);
  EXPECT_EQ(here.locationFlags, 15U);
  EXPECT_FLOAT_EQ(here.pose.position.x, 2.0F);
  EXPECT_FLOAT_EQ(here.pose.position.y, 1.6F);
  EXPECT_EQ(velocity.velocityFlags, 3U);
  EXPECT_NEAR(velocity.linearVelocity.x, 100.0F, 1e-3F);  // 1 m in 10 ms
  // Half a frame earlier it was half way.
  EXPECT_NEAR(locate(view, stage, nullptr, 5'000'000).pose.position.x, 1.5F, 1e-5F);
  // Seen from the head, the stage moves the other way.
  const XrSpaceLocation back = locate(stage, view, &velocity);
  EXPECT_FLOAT_EQ(back.pose.position.x, -2.0F);
  EXPECT_NEAR(velocity.linearVelocity.x, -100.0F, 1e-3F);
}

TEST_F(Spaces, LocalIsWhereTheHeadWasAtFirst) {
  start(kVersion11);
  frames(2);
  const XrSpace stage = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_STAGE);
  const XrSpace local = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_LOCAL);
  EXPECT_FLOAT_EQ(locate(local, stage).pose.position.y, 1.6F);
  EXPECT_FLOAT_EQ(locate(local, stage).pose.position.x, 0.0F);
  const XrSpace floor = program.referenceSpace(xr::kLocalFloor);
  EXPECT_FLOAT_EQ(locate(floor, stage).pose.position.y, 0.0F);
}

TEST_F(Spaces, LocalFloorIsOf11) {
  start();
  const XrReferenceSpaceCreateInfo info{
      XR_TYPE_REFERENCE_SPACE_CREATE_INFO, nullptr, xr::kLocalFloor, {{0, 0, 0, 1}, {0, 0, 0}}};
  XrSpace space = XR_NULL_HANDLE;
  EXPECT_EQ(XR_CALL(program.instance, xrCreateReferenceSpace)(program.session, &info, &space),
            XR_ERROR_REFERENCE_SPACE_UNSUPPORTED);
  PFN_xrVoidFunction found = nullptr;
  EXPECT_EQ(calls::xrGetInstanceProcAddr(program.instance, "xrLocateSpaces", &found),
            XR_ERROR_FUNCTION_UNSUPPORTED);
}

TEST_F(Spaces, SeveralAreLocatedAtOnce) {
  start(kVersion11);
  frames(2);
  const XrSpace stage = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_STAGE);
  const XrSpace spaces[]{program.referenceSpace(XR_REFERENCE_SPACE_TYPE_VIEW), stage};
  const auto locateSpaces = reinterpret_cast<decltype(&calls::xrLocateSpaces)>(
      function(program.instance, "xrLocateSpaces"));
  SpacesLocateInfo info{kSpacesLocateInfoType,      nullptr, stage,
                        state.predictedDisplayTime, 2,       spaces};
  SpaceLocationData data[2]{};
  SpaceLocations locations{kSpaceLocationsType, nullptr, 2, data};
  EXPECT_EQ(locateSpaces(program.session, &info, &locations), XR_SUCCESS);
  EXPECT_FLOAT_EQ(data[0].pose.position.x, 1.0F);
  EXPECT_FLOAT_EQ(data[1].pose.position.x, 0.0F);
  locations.count = 1;
  EXPECT_EQ(locateSpaces(program.session, &info, &locations), XR_ERROR_VALIDATION_FAILURE);
  locations.count = 2;
  info.time = 0;
  EXPECT_EQ(locateSpaces(program.session, &info, &locations), XR_ERROR_TIME_INVALID);
}

TEST_F(Spaces, EyesAreAnIpdApart) {
  start();
  frames(1);
  const XrViewLocateInfo info{XR_TYPE_VIEW_LOCATE_INFO, nullptr,
                              XR_VIEW_CONFIGURATION_TYPE_PRIMARY_STEREO, state.predictedDisplayTime,
                              program.referenceSpace(XR_REFERENCE_SPACE_TYPE_STAGE)};
  XrViewState view_state{XR_TYPE_VIEW_STATE, nullptr, 0};
  XrView views[2]{};
  views[0].type = views[1].type = XR_TYPE_VIEW;
  std::uint32_t count = 0;
  ASSERT_EQ(XR_CALL(program.instance, xrLocateViews)(program.session, &info, &view_state, 2, &count,
                                                     views),
            XR_SUCCESS);
  EXPECT_EQ(count, 2U);
  EXPECT_EQ(view_state.viewStateFlags, 15U);
  EXPECT_FLOAT_EQ(views[0].pose.position.x, -0.032F);
  EXPECT_FLOAT_EQ(views[1].pose.position.x, 0.032F);
  EXPECT_FLOAT_EQ(views[0].fov.angleUp, static_cast<float>(M_PI / 4.0));  // 90 degrees
  EXPECT_FLOAT_EQ(views[0].fov.angleRight, std::atan(2.0F));              // 4 x 2 pixels
  EXPECT_EQ(XR_CALL(program.instance, xrLocateViews)(program.session, &info, &view_state, 1, &count,
                                                     views),
            XR_ERROR_SIZE_INSUFFICIENT);
}

TEST_F(Spaces, OffsetsTurnAndMoveWithTheirSpace) {
  start();
  frames(2);
  // A quarter turn about y, a metre to the right of the head.
  const auto half = static_cast<float>(std::sqrt(0.5));
  const XrReferenceSpaceCreateInfo info{XR_TYPE_REFERENCE_SPACE_CREATE_INFO,
                                        nullptr,
                                        XR_REFERENCE_SPACE_TYPE_VIEW,
                                        {{0, half, 0, half}, {1, 0, 0}}};
  XrSpace space = XR_NULL_HANDLE;
  ASSERT_EQ(XR_CALL(program.instance, xrCreateReferenceSpace)(program.session, &info, &space),
            XR_SUCCESS);
  const XrSpace stage = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_STAGE);
  const XrSpaceLocation location = locate(space, stage);
  EXPECT_NEAR(location.pose.position.x, 2.0F, 1e-6F);
  EXPECT_NEAR(location.pose.orientation.y, half, 1e-6F);
  // STAGE's origin lies 2 m along stage's -x, which is its -z.
  EXPECT_NEAR(locate(stage, space).pose.position.z, -2.0F, 1e-5F);
}

TEST_F(Spaces, WrongValuesHaveTheirCodes) {
  start();
  frames(1);
  XrReferenceSpaceCreateInfo info{XR_TYPE_REFERENCE_SPACE_CREATE_INFO,
                                  nullptr,
                                  XR_REFERENCE_SPACE_TYPE_STAGE,
                                  {{0, 0, 0, 0}, {0, 0, 0}}};
  XrSpace space = XR_NULL_HANDLE;
  const auto create = XR_CALL(program.instance, xrCreateReferenceSpace);
  EXPECT_EQ(create(program.session, &info, &space), XR_ERROR_POSE_INVALID);
  info.poseInReferenceSpace = {{0, 0, 0, 1}, {NAN, 0, 0}};
  EXPECT_EQ(create(program.session, &info, &space), XR_ERROR_POSE_INVALID);
  info.poseInReferenceSpace.position.x = 0.0F;
  ASSERT_EQ(create(program.session, &info, &space), XR_SUCCESS);
  XrSpaceLocation location{XR_TYPE_SPACE_LOCATION, nullptr, 0, {}};
  const auto locate_space = XR_CALL(program.instance, xrLocateSpace);
  EXPECT_EQ(locate_space(space, space, 0, &location), XR_ERROR_TIME_INVALID);
  EXPECT_EQ(locate_space(space, space, -5, &location), XR_ERROR_TIME_INVALID);
  EXPECT_EQ(XR_CALL(program.instance, xrDestroySpace)(space), XR_SUCCESS);
  EXPECT_EQ(locate_space(space, space, 1, &location), XR_ERROR_HANDLE_INVALID);
  // Its place in the table has another owner now, and the old handle does not name it.
  ASSERT_EQ(create(program.session, &info, &space), XR_SUCCESS);
  XrExtent2Df bounds{};
  EXPECT_EQ(XR_CALL(program.instance, xrGetReferenceSpaceBoundsRect)(
                program.session, XR_REFERENCE_SPACE_TYPE_STAGE, &bounds),
            XR_SPACE_BOUNDS_UNAVAILABLE);
}

}  // namespace
}  // namespace sim2vr::openxr::test

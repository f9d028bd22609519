// SPDX-License-Identifier: Apache-2.0
// The sessions of our own games (session.hpp).
#include "sim2vr/xr/session.hpp"

#include "support.hpp"

namespace sim2vr::xr {
namespace {

constexpr const char* kRightTrigger = "/user/hand/right/input/trigger/value";
constexpr XrHapticVibration kHum{XR_TYPE_HAPTIC_VIBRATION, nullptr, 20'000'000, 160.0F, 0.5F};

class Sessions : public ::testing::Test {
 protected:
  Session session_;
  ActionSet& set_ = session_.createActionSet("play");
  Action& fire_ = session_.createAction(set_, "fire", XR_ACTION_TYPE_FLOAT_INPUT, {Hand::right});
};

TEST_F(Sessions, AllIsAsOfTheLatestFrame) {
  session_.suggestBinding(fire_, kRightTrigger);
  EXPECT_EQ(errorOf<StateError>([&] { session_.nextFrame(0, {}); }),
            "nextFrame: no action sets are attached; call attachActionSets first");
  session_.attachActionSets();
  EXPECT_EQ(session_.frameTime(), 0);
  session_.nextFrame(100, pulled(0.25F));
  EXPECT_EQ(session_.frameTime(), 100);
  EXPECT_EQ(session_.actionState(fire_).value.x, 0.25F);
  EXPECT_EQ(session_.actionState(fire_, Hand::right).last_change, 100);
  EXPECT_FALSE(session_.actionState(fire_, Hand::left).active);
}

TEST_F(Sessions, BindingErrors) {
  const auto error = [&](const char* path) {
    return errorOf<InvalidArgument>([&] { session_.suggestBinding(fire_, path); });
  };
  EXPECT_EQ(
      error("/user/hand/right/input/triger/value"),
      "binding path: got '/user/hand/right/input/triger/value', expected an input or output of "
      "the Touch controllers; did you mean '/user/hand/right/input/trigger/value'?");
  for (const std::string path :
       {"/user/hand/right/input/thumbstick", "/user/hand/left/input/trigger/value"}) {
    EXPECT_EQ(error(path.c_str()), "binding path: got '" + path +
                                       "', expected a path for the float action 'fire' and of a "
                                       "hand that it was created with");
  }
  EXPECT_EQ(error("/user/hand/right/input/x/click").substr(0, 12), "binding path");
  EXPECT_EQ(error("/user/hand/right/input/system/click").substr(0, 12), "binding path");
  EXPECT_EQ(error("/user/hand/right/input/trigger"), "none") << "the value is understood";
}

TEST_F(Sessions, SetsAndNamesAreCheckedAndFixedOnceAttached) {
  EXPECT_EQ(errorOf<InvalidArgument>([&] { session_.createActionSet("play"); }),
            "action set name: got 'play' twice, expected a name not used before");
  EXPECT_EQ(errorOf<InvalidArgument>([&] { session_.createActionSet("My Set"); }),
            "action set name: got 'My Set', expected 1 to 63 characters out of a-z 0-9 - _ .");
  const auto action = [&](const std::string& name, XrActionType type) {
    return errorOf<InvalidArgument>([&] { session_.createAction(set_, name, type); });
  };
  EXPECT_EQ(action("fire", XR_ACTION_TYPE_FLOAT_INPUT),
            "action name: got 'fire' twice, expected a name not used before");
  EXPECT_EQ(action("odd", XR_ACTION_TYPE_MAX_ENUM),
            "action 'odd' type: got 2147483647, expected boolean, float, vector2f or pose input, "
            "or vibration output");
  EXPECT_EQ(action(std::string(64, 'a'), XR_ACTION_TYPE_FLOAT_INPUT).substr(0, 11), "action name");
  session_.attachActionSets();
  EXPECT_EQ(errorOf<StateError>([&] { session_.attachActionSets(); }),
            "attachActionSets: the action sets are attached already; that is possible once per "
            "session");
  EXPECT_THROW(session_.createActionSet("late"), StateError);
  EXPECT_THROW(session_.createAction(set_, "late", XR_ACTION_TYPE_FLOAT_INPUT), StateError);
  EXPECT_THROW(session_.suggestBinding(fire_, kRightTrigger), StateError);
  EXPECT_EQ(session_.findAction("play", "fire"), &fire_);
  EXPECT_EQ(session_.findAction("none", "fire"), nullptr);
}

TEST_F(Sessions, VibrationsReachTheBoundAndTrackedHandsOnce) {
  Action& buzz = session_.createAction(set_, "buzz", XR_ACTION_TYPE_VIBRATION_OUTPUT);
  session_.suggestBinding(buzz, "/user/hand/left/output/haptic");
  session_.suggestBinding(buzz, "/user/hand/right/output/haptic");
  session_.attachActionSets();
  session_.applyHapticFeedback(buzz, Hand::right, kHum);
  EXPECT_TRUE(session_.takePulses().empty()) << "no frame yet";
  session_.nextFrame(0, pulled(0.0F));
  session_.applyHapticFeedback(buzz, Hand::left, kHum);
  EXPECT_TRUE(session_.takePulses().empty()) << "not tracked";
  session_.applyHapticFeedback(buzz, Hand::right, kHum);
  session_.applyHapticFeedback(buzz, std::nullopt, kHum);
  const auto pulses = session_.takePulses();
  ASSERT_EQ(pulses.size(), 2U);
  EXPECT_EQ(pulses[0].hand, Hand::right);
  EXPECT_EQ(pulses[0].amplitude, 0.5F);
  EXPECT_EQ(pulses[0].frequency_hz, 160.0F);
  EXPECT_EQ(pulses[1].duration_ns, 20'000'000);
  EXPECT_TRUE(session_.takePulses().empty());
}

TEST_F(Sessions, WrongVibrationsAndSpacesAreRefused) {
  Action& buzz = session_.createAction(set_, "buzz", XR_ACTION_TYPE_VIBRATION_OUTPUT);
  const auto error = [&](const Action& action, const XrHapticVibration& vibration) {
    return errorOf<InvalidArgument>(
        [&] { session_.applyHapticFeedback(action, std::nullopt, vibration); });
  };
  XrHapticVibration loud = kHum;
  loud.amplitude = 1.5F;
  EXPECT_EQ(error(buzz, loud),
            "vibration: got amplitude 1.500000, frequency 160.000000, duration 20000000, expected "
            "0 to 1, 0 Hz or more, and 0 ns or more or XR_MIN_HAPTIC_DURATION");
  EXPECT_EQ(error(fire_, kHum), "action 'fire': got float, expected a vibration output");
  EXPECT_EQ(errorOf<InvalidArgument>([&] { session_.actionSpace(fire_, Hand::right); }),
            "action 'fire': got a request for an action space, expected a pose action that was "
            "created with this hand");
}

// Of a game as of a program, LOCAL is the whole place of the head in the first frame.
TEST_F(Sessions, LocatesInStage) {
  Action& hand = session_.createAction(set_, "hand", XR_ACTION_TYPE_POSE_INPUT);
  session_.suggestBinding(hand, "/user/hand/right/input/grip/pose");
  session_.attachActionSets();
  DeviceState devices = pulled(0.0F);
  devices.head.position = {0.2F, 1.6F, -0.3F};
  devices.hand(Hand::right).grip.position = {0.5F, 1.0F, -0.5F};
  session_.nextFrame(0, devices);
  const auto local = session_.locateSpace({.reference = XR_REFERENCE_SPACE_TYPE_LOCAL});
  expectPose(local.value(), {{0, 0, 0, 1}, {0.2F, 1.6F, -0.3F}});
  devices.head.position.x = 0.0F;
  session_.nextFrame(1, devices);
  expectPose(session_.locateSpace({.reference = XR_REFERENCE_SPACE_TYPE_LOCAL}).value(), *local);
  EXPECT_EQ(session_.locateSpace({.reference = XR_REFERENCE_SPACE_TYPE_VIEW})->position.x, 0.0F);
  EXPECT_EQ(session_.locateSpace(session_.actionSpace(hand, Hand::right))->position.z, -0.5F);
  EXPECT_FALSE(session_.locateSpace(session_.actionSpace(hand, Hand::left)));
  const auto views = session_.locateViews();
  expectPose(views[0].pose, {{0, 0, 0, 1}, {-0.032F, 0.0F, 0.0F}});
  EXPECT_FLOAT_EQ(views[1].fov.angleRight, std::atan(1.5F));
}

TEST(Session, SettingsAreChecked) {
  const auto field = [](const SessionSettings& settings) {
    try {
      const Session session(settings);
    } catch (const InvalidArgument& error) {
      return error.field();
    }
    return std::string("none");
  };
  EXPECT_EQ(field({-0.1F, 90.0F, 1.5F}), "ipd_m");
  EXPECT_EQ(field({0.06F, 180.0F, 1.5F}), "vertical_fov_deg");
  EXPECT_EQ(field({0.06F, 90.0F, 0.0F}), "aspect");
  EXPECT_EQ(field({}), "none");
}

TEST_F(Sessions, SavedStateContinuesAndThatOfOtherActionsIsRefused) {
  session_.suggestBinding(fire_, kRightTrigger);
  session_.attachActionSets();
  session_.nextFrame(100, pulled(0.5F));
  Archive saved = Archive::saver();
  session_.fields(saved);
  const auto load = [&](Session& session) {
    Archive loader = Archive::loader(saved.bytes());
    session.fields(loader);
    loader.expectEnd();
  };
  Session fresh;
  Action& fire = fresh.createAction(fresh.createActionSet("play"), "fire",
                                    XR_ACTION_TYPE_FLOAT_INPUT, {Hand::right});
  fresh.suggestBinding(fire, kRightTrigger);
  fresh.attachActionSets();
  load(fresh);
  EXPECT_EQ(fresh.frameTime(), 100);
  EXPECT_EQ(fresh.actionState(fire, Hand::right).last_change, 100);
  fresh.nextFrame(200, pulled(0.5F));
  EXPECT_FALSE(fresh.actionState(fire).changed);
  Archive again = Archive::saver();
  session_.fields(again);
  EXPECT_EQ(again.bytes(), saved.bytes()) << "saving changes nothing";

  Session none;
  EXPECT_EQ(errorOf<EngineError>([&] { load(none); }),
            "saved state: it has 1 actions, this session has 0");
  Session other;
  other.createAction(other.createActionSet("play"), "drop", XR_ACTION_TYPE_FLOAT_INPUT);
  EXPECT_EQ(errorOf<EngineError>([&] { load(other); }),
            "saved state: action 'fire' where this session has 'drop'");
}

}  // namespace
}  // namespace sim2vr::xr

#include "support.hpp"

namespace sim2vr::xr {
namespace {

constexpr const char* kRightTrigger = "/user/hand/right/input/trigger/value";

class Actions : public ::testing::Test {
 protected:
  Action& add(const std::string& name, XrActionType type, std::vector<Hand> hands,
              const std::vector<std::string>& paths) {
    Action& action = set_.createAction(name, type, std::move(hands));
    for (const std::string& path : paths) session_.suggestBinding(action, path);
    return action;
  }

  void start() {
    session_.attachActionSets();
    session_.begin();
    frame(session_, 0);
  }

  // The next frame, with this state of the right controller.
  void play(XrTime time, const ControllerState& right) {
    device_.state.hand(Hand::right) = right;
    session_.waitFrame(time, kPeriod);
    session_.syncActions();
    session_.beginFrame();
    session_.endFrame();
  }

  static ControllerState pulled(float trigger) {
    ControllerState state = activeController();
    state.trigger = trigger;
    return state;
  }

  CountingDevice device_;
  Session session_{device_};
  ActionSet& set_ = session_.createActionSet("play");
};

TEST_F(Actions, FloatReportsChangesBetweenSyncs) {
  const Action& fire = add("fire", XR_ACTION_TYPE_FLOAT_INPUT, {Hand::right}, {kRightTrigger});
  start();
  EXPECT_EQ(session_.getActionStateFloat(fire, Hand::right).isActive, XR_FALSE) << "no sync yet";
  play(100, pulled(0.0F));
  XrActionStateFloat state = session_.getActionStateFloat(fire, Hand::right);
  EXPECT_EQ(state.type, XR_TYPE_ACTION_STATE_FLOAT);
  EXPECT_EQ(state.isActive, XR_TRUE);
  EXPECT_EQ(state.changedSinceLastSync, XR_FALSE);
  EXPECT_EQ(state.lastChangeTime, 0);
  play(200, pulled(0.25F));
  state = session_.getActionStateFloat(fire, Hand::right);
  EXPECT_EQ(state.currentState, 0.25F);
  EXPECT_EQ(state.changedSinceLastSync, XR_TRUE);
  EXPECT_EQ(state.lastChangeTime, 200);
  play(300, pulled(0.25F));
  state = session_.getActionStateFloat(fire, Hand::right);
  EXPECT_EQ(state.currentState, 0.25F);
  EXPECT_EQ(state.changedSinceLastSync, XR_FALSE);
  EXPECT_EQ(state.lastChangeTime, 200);
}

TEST_F(Actions, ValuesAreConstantBetweenSyncs) {
  const Action& fire = add("fire", XR_ACTION_TYPE_FLOAT_INPUT, {Hand::right}, {kRightTrigger});
  start();
  play(100, pulled(0.25F));
  device_.state.hand(Hand::right).trigger = 1.0F;
  session_.waitFrame(200, kPeriod);
  EXPECT_EQ(session_.getActionStateFloat(fire, Hand::right).currentState, 0.25F);
  EXPECT_EQ(session_.getActionStateFloat(fire, Hand::right).changedSinceLastSync, XR_TRUE);
  session_.syncActions();
  EXPECT_EQ(session_.getActionStateFloat(fire, Hand::right).currentState, 1.0F);
  session_.syncActions();
  EXPECT_EQ(session_.getActionStateFloat(fire, Hand::right).changedSinceLastSync, XR_FALSE);
}

TEST_F(Actions, SyncSamplesTheDeviceOnceAtTheFramesTime) {
  add("fire", XR_ACTION_TYPE_FLOAT_INPUT, {Hand::right}, {kRightTrigger});
  add("hand", XR_ACTION_TYPE_POSE_INPUT, {Hand::right}, {"/user/hand/right/input/grip/pose"});
  start();
  device_.times.clear();
  session_.waitFrame(700, kPeriod);
  session_.syncActions();
  session_.locateViews(700, session_.referenceSpace(XR_REFERENCE_SPACE_TYPE_STAGE));
  EXPECT_EQ(device_.times, (std::vector<XrTime>{700}));
}

TEST_F(Actions, BooleanPressesFromTheMiddleOn) {
  const Action& fire = add("fire", XR_ACTION_TYPE_BOOLEAN_INPUT, {Hand::right}, {kRightTrigger});
  start();
  play(100, pulled(0.49F));
  EXPECT_EQ(session_.getActionStateBoolean(fire, Hand::right).currentState, XR_FALSE);
  play(200, pulled(0.5F));
  EXPECT_EQ(session_.getActionStateBoolean(fire, Hand::right).currentState, XR_TRUE);
  EXPECT_EQ(session_.getActionStateBoolean(fire, Hand::right).changedSinceLastSync, XR_TRUE);
  play(300, pulled(0.9F));
  EXPECT_EQ(session_.getActionStateBoolean(fire, Hand::right).changedSinceLastSync, XR_FALSE)
      << "still pressed";
}

TEST_F(Actions, ButtonsAndStickOfBothHands) {
  const Action& jump = add("jump", XR_ACTION_TYPE_BOOLEAN_INPUT, {Hand::left, Hand::right},
                           {"/user/hand/left/input/x/click", "/user/hand/right/input/a/click"});
  const Action& move =
      add("move", XR_ACTION_TYPE_VECTOR2F_INPUT, {Hand::left, Hand::right},
          {"/user/hand/left/input/thumbstick", "/user/hand/right/input/thumbstick"});
  const Action& strafe = add("strafe", XR_ACTION_TYPE_FLOAT_INPUT, {Hand::left},
                             {"/user/hand/left/input/thumbstick/x"});
  start();
  ControllerState left = activeController();
  left.x = true;
  left.thumbstick = {-0.5F, 0.25F};
  device_.state.hand(Hand::left) = left;
  ControllerState right = activeController();
  right.thumbstick = {0.0F, 0.75F};
  play(100, right);
  EXPECT_EQ(session_.getActionStateBoolean(jump, Hand::left).currentState, XR_TRUE);
  EXPECT_EQ(session_.getActionStateBoolean(jump, Hand::right).currentState, XR_FALSE);
  EXPECT_EQ(session_.getActionStateBoolean(jump).currentState, XR_TRUE) << "combined: or";
  EXPECT_EQ(session_.getActionStateVector2f(move, Hand::left).currentState.x, -0.5F);
  EXPECT_EQ(session_.getActionStateVector2f(move).currentState.y, 0.75F) << "combined: longest";
  EXPECT_EQ(session_.getActionStateFloat(strafe, Hand::left).currentState, -0.5F);
}

TEST_F(Actions, InactiveControllerReadsAsNothing) {
  const Action& fire = add("fire", XR_ACTION_TYPE_FLOAT_INPUT, {Hand::right}, {kRightTrigger});
  const Action& unbound = set_.createAction("unbound", XR_ACTION_TYPE_FLOAT_INPUT, {Hand::right});
  start();
  play(100, pulled(0.5F));
  EXPECT_EQ(session_.getActionStateFloat(unbound, Hand::right).isActive, XR_FALSE);
  play(200, ControllerState{});
  XrActionStateFloat state = session_.getActionStateFloat(fire, Hand::right);
  EXPECT_EQ(state.isActive, XR_FALSE);
  EXPECT_EQ(state.currentState, 0.0F);
  EXPECT_EQ(state.changedSinceLastSync, XR_FALSE);
  EXPECT_EQ(state.lastChangeTime, 0);
  play(300, pulled(0.5F));
  state = session_.getActionStateFloat(fire, Hand::right);
  EXPECT_EQ(state.changedSinceLastSync, XR_TRUE) << "0 while it was away";
  EXPECT_EQ(state.lastChangeTime, 300);
}

TEST_F(Actions, OnlyAFocusedSessionDelivers) {
  const Action& fire = add("fire", XR_ACTION_TYPE_FLOAT_INPUT, {Hand::right}, {kRightTrigger});
  start();
  play(100, pulled(0.5F));
  session_.setInputFocus(false);
  EXPECT_EQ(session_.syncActions(), XR_SESSION_NOT_FOCUSED);
  EXPECT_EQ(session_.getActionStateFloat(fire, Hand::right).isActive, XR_FALSE);
  session_.setInputFocus(true);
  EXPECT_EQ(session_.syncActions(), XR_SUCCESS);
  EXPECT_EQ(session_.getActionStateFloat(fire, Hand::right).currentState, 0.5F);
}

TEST_F(Actions, PoseActionIsActiveWithItsController) {
  const Action& hand = add("hand", XR_ACTION_TYPE_POSE_INPUT, {Hand::left, Hand::right},
                           {"/user/hand/left/input/grip/pose", "/user/hand/right/input/grip/pose"});
  start();
  play(100, activeController());
  EXPECT_EQ(session_.getActionStatePose(hand, Hand::right).isActive, XR_TRUE);
  EXPECT_EQ(session_.getActionStatePose(hand, Hand::left).isActive, XR_FALSE);
  EXPECT_EQ(session_.getActionStatePose(hand).isActive, XR_TRUE);
}

TEST_F(Actions, ReadingBeforeAttachOrAsAnotherTypeNamesTheAction) {
  const Action& fire = add("fire", XR_ACTION_TYPE_FLOAT_INPUT, {Hand::right}, {kRightTrigger});
  EXPECT_EQ(errorOf<StateError>([&] { session_.getActionStateFloat(fire, Hand::right); }),
            "action 'fire': its set is not attached to the session; call attachActionSets first");
  session_.begin();
  EXPECT_EQ(errorOf<StateError>([&] { session_.syncActions(); }),
            "syncActions: no action sets are attached; call attachActionSets first");
  session_.attachActionSets();
  EXPECT_EQ(errorOf<InvalidArgument>([&] { session_.getActionStateBoolean(fire, Hand::right); }),
            "action 'fire': got a call for a boolean action, expected one for its own type, float");
  EXPECT_EQ(errorOf<InvalidArgument>([&] { session_.getActionStateFloat(fire, Hand::left); }),
            "action 'fire': got the left hand, expected a hand that the action was created with");
}

TEST_F(Actions, BindingErrors) {
  Action& fire = set_.createAction("fire", XR_ACTION_TYPE_FLOAT_INPUT, {Hand::right});
  const auto error = [&](const char* path) {
    return errorOf<InvalidArgument>([&] { session_.suggestBinding(fire, path); });
  };
  EXPECT_EQ(
      error("/user/hand/right/input/triger/value"),
      "binding path: got '/user/hand/right/input/triger/value', expected an input or output of "
      "the Touch controllers; did you mean '/user/hand/right/input/trigger/value'?");
  EXPECT_EQ(error("/user/hand/right/input/thumbstick"),
            "binding path: got '/user/hand/right/input/thumbstick', expected a path for the float "
            "action 'fire'");
  EXPECT_EQ(
      error("/user/hand/left/input/trigger/value"),
      "binding path: got '/user/hand/left/input/trigger/value', expected a path of a hand that "
      "action 'fire' was created with");
  EXPECT_EQ(error("/user/hand/right/input/x/click").substr(0, 12), "binding path");
  EXPECT_EQ(error("/user/hand/right/input/trigger"), "none") << "the value is understood";
}

TEST_F(Actions, SetsAndNamesAreCheckedAndFixedOnceAttached) {
  EXPECT_EQ(errorOf<InvalidArgument>([&] { session_.createActionSet("play"); }),
            "action set name: got 'play' twice, expected a name not used before");
  EXPECT_EQ(errorOf<InvalidArgument>([&] { session_.createActionSet("My Set"); }),
            "action set name: got 'My Set', expected 1 to 63 characters out of a-z 0-9 - _ .");
  Action& fire = set_.createAction("fire", XR_ACTION_TYPE_FLOAT_INPUT);
  EXPECT_EQ(
      errorOf<InvalidArgument>([&] { set_.createAction("fire", XR_ACTION_TYPE_FLOAT_INPUT); }),
      "action name: got 'fire' twice, expected a name not used before in the action set "
      "'play'");
  session_.attachActionSets();
  EXPECT_EQ(errorOf<StateError>([&] { session_.attachActionSets(); }),
            "attachActionSets: the action sets are attached already; that is possible once per "
            "session");
  EXPECT_THROW(session_.createActionSet("late"), StateError);
  EXPECT_THROW(session_.suggestBinding(fire, kRightTrigger), StateError);
  EXPECT_EQ(
      errorOf<StateError>([&] { set_.createAction("late", XR_ACTION_TYPE_FLOAT_INPUT); }),
      "createAction('late'): action set 'play' is attached already; create all actions before "
      "attachActionSets");
  EXPECT_EQ(session_.findActionSet("play"), &set_);
  EXPECT_EQ(set_.findAction("fire"), &fire);
  EXPECT_EQ(session_.findActionSet("none"), nullptr);
}

TEST(Haptics, ReachTheDeviceOfTheBoundAndActiveHand) {
  SimulatedDevice device;
  Session session(device);
  ActionSet& set = session.createActionSet("play");
  Action& buzz =
      set.createAction("buzz", XR_ACTION_TYPE_VIBRATION_OUTPUT, {Hand::left, Hand::right});
  session.suggestBinding(buzz, "/user/hand/left/output/haptic");
  session.suggestBinding(buzz, "/user/hand/right/output/haptic");
  session.attachActionSets();
  session.begin();
  const XrHapticVibration hum{XR_TYPE_HAPTIC_VIBRATION, nullptr, 20'000'000, 160.0F, 0.5F};
  EXPECT_EQ(session.applyHapticFeedback(buzz, Hand::right, hum), XR_SESSION_NOT_FOCUSED);
  device.setController(Hand::right, activeController());
  frame(session, 0);
  session.syncActions();
  EXPECT_EQ(session.applyHapticFeedback(buzz, Hand::right, hum), XR_SUCCESS);
  EXPECT_EQ(session.applyHapticFeedback(buzz, std::nullopt, hum), XR_SUCCESS);
  EXPECT_EQ(device.hapticCount(Hand::right), 2U);
  EXPECT_EQ(device.hapticCount(Hand::left), 0U) << "not active";
  EXPECT_EQ(device.lastHaptic(Hand::right).amplitude, 0.5F);
  EXPECT_EQ(device.lastHaptic(Hand::right).duration, 20'000'000);
  session.stopHapticFeedback(buzz, Hand::right);
  EXPECT_EQ(device.lastHaptic(Hand::right).amplitude, 0.0F);
  EXPECT_EQ(device.hapticCount(Hand::right), 2U);
  XrHapticVibration loud = hum;
  loud.amplitude = 1.5F;
  EXPECT_EQ(errorOf<InvalidArgument>([&] { session.applyHapticFeedback(buzz, Hand::right, loud); }),
            "vibration.amplitude: got 1.500000, expected a number from 0 to 1");
  loud = hum;
  loud.duration = 0;
  EXPECT_THROW(session.applyHapticFeedback(buzz, Hand::right, loud), InvalidArgument);
}

}  // namespace
}  // namespace sim2vr::xr

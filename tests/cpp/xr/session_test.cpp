// Life cycle, frame loop and saving.
#include "support.hpp"

namespace sim2vr::xr {
namespace {

using States = std::vector<XrSessionState>;

TEST(Session, StatesOfAWholeLife) {
  SimulatedDevice device;
  Session session(device);
  EXPECT_EQ(drain(session), (States{XR_SESSION_STATE_IDLE, XR_SESSION_STATE_READY}));
  EXPECT_FALSE(session.isRunning());
  session.begin();
  EXPECT_TRUE(session.isRunning());
  EXPECT_EQ(drain(session), (States{XR_SESSION_STATE_SYNCHRONIZED}));
  frame(session, 0);
  EXPECT_EQ(drain(session), (States{XR_SESSION_STATE_VISIBLE, XR_SESSION_STATE_FOCUSED}));
  frame(session, kPeriod);
  EXPECT_EQ(drain(session), States{});
  session.requestExit();
  EXPECT_EQ(drain(session), (States{XR_SESSION_STATE_VISIBLE, XR_SESSION_STATE_SYNCHRONIZED,
                                    XR_SESSION_STATE_STOPPING}));
  session.end();
  EXPECT_EQ(drain(session), (States{XR_SESSION_STATE_IDLE, XR_SESSION_STATE_EXITING}));
  EXPECT_EQ(session.state(), XR_SESSION_STATE_EXITING);
}

TEST(Session, EventsCarryTypeAndTime) {
  SimulatedDevice device;
  Session session(device);
  session.begin();
  drain(session);
  session.waitFrame(70, kPeriod);
  const auto event = session.pollEvent();
  ASSERT_TRUE(event.has_value());
  EXPECT_EQ(event->type, XR_TYPE_EVENT_DATA_SESSION_STATE_CHANGED);
  EXPECT_EQ(event->time, 70);
}

TEST(Session, WrongOrderNamesCallAndState) {
  SimulatedDevice device;
  Session session(device);
  const auto error = [&](auto call) { return errorOf<StateError>([&] { call(); }); };
  EXPECT_EQ(error([&] { session.end(); }),
            "end: the session is READY; it can end only when STOPPING (call requestExit first)");
  EXPECT_EQ(error([&] { session.requestExit(); }),
            "requestExit: the session is READY; it must be running (call begin when READY)");
  EXPECT_EQ(error([&] { session.waitFrame(0, 1); }),
            "waitFrame: the session is READY; it must be running (call begin when READY)");
  session.begin();
  EXPECT_EQ(error([&] { session.begin(); }),
            "begin: the session is SYNCHRONIZED; it can begin only when READY");
  session.requestExit();
  EXPECT_EQ(error([&] { session.requestExit(); }),
            "requestExit: the session is STOPPING already; call end");
  session.end();
  EXPECT_EQ(error([&] { session.begin(); }),
            "begin: the session is EXITING; it can begin only when READY");
}

TEST(Session, FrameLoopOrderIsStrict) {
  SimulatedDevice device;
  Session session(device);
  session.begin();
  const auto error = [&](auto call) { return errorOf<StateError>([&] { call(); }); };
  EXPECT_EQ(error([&] { session.beginFrame(); }),
            "beginFrame: call waitFrame first (session SYNCHRONIZED; the order is waitFrame, "
            "beginFrame, endFrame)");
  EXPECT_EQ(error([&] { session.endFrame(); }).substr(0, 31), "endFrame: call beginFrame first");
  session.waitFrame(0, 1);
  EXPECT_EQ(error([&] { session.waitFrame(1, 1); }).substr(0, 32),
            "waitFrame: call beginFrame first");
  session.beginFrame();
  EXPECT_EQ(error([&] { session.beginFrame(); }).substr(0, 32), "beginFrame: call waitFrame first");
  EXPECT_EQ(error([&] { session.waitFrame(1, 1); }).substr(0, 30),
            "waitFrame: call endFrame first");
  session.endFrame();
  session.waitFrame(1, 1);
}

TEST(Session, FrameStateEchoesTheCallersTime) {
  SimulatedDevice device;
  Session session(device);
  session.begin();
  const XrFrameState state = session.waitFrame(123, 45);
  EXPECT_EQ(state.type, XR_TYPE_FRAME_STATE);
  EXPECT_EQ(state.predictedDisplayTime, 123);
  EXPECT_EQ(state.predictedDisplayPeriod, 45);
  EXPECT_EQ(state.shouldRender, XR_TRUE);
  session.beginFrame();
  session.endFrame();
  EXPECT_EQ(errorOf<InvalidArgument>([&] { session.waitFrame(122, 45); }),
            "predicted_display_time: got 122, expected a time not before the previous frame's 123");
  EXPECT_EQ(errorOf<InvalidArgument>([&] { session.waitFrame(124, -1); }),
            "period: got -1, expected a duration of 0 ns or more");
  session.requestExit();
  EXPECT_EQ(session.waitFrame(124, 45).shouldRender, XR_FALSE) << "stopping";
}

TEST(Session, InputFocusComesAndGoes) {
  SimulatedDevice device;
  Session session(device);
  session.begin();
  session.setInputFocus(true);
  EXPECT_EQ(session.state(), XR_SESSION_STATE_SYNCHRONIZED) << "no focus before it is visible";
  frame(session, 0);
  session.setInputFocus(false);
  EXPECT_EQ(session.state(), XR_SESSION_STATE_VISIBLE);
  frame(session, 1);
  EXPECT_EQ(session.state(), XR_SESSION_STATE_VISIBLE) << "a frame does not give it back";
  session.setInputFocus(true);
  EXPECT_EQ(session.state(), XR_SESSION_STATE_FOCUSED);
}

TEST(Session, SettingsAreChecked) {
  SimulatedDevice device;
  const auto field = [&](SessionSettings settings) {
    try {
      const Session session(device, settings);
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

void build(Session& session) {
  ActionSet& set = session.createActionSet("play");
  Action& grab = set.createAction("grab", XR_ACTION_TYPE_FLOAT_INPUT, {Hand::right});
  session.suggestBinding(grab, "/user/hand/right/input/squeeze/value");
  session.attachActionSets();
}

TEST(Session, SavedStateContinues) {
  SimulatedDevice device;
  Session session(device);
  build(session);
  session.begin();
  device.setHead({{0, 0, 0, 1}, {0, 1.5F, 0}});
  ControllerState right = activeController();
  right.squeeze = 0.5F;
  device.setController(Hand::right, right);
  session.waitFrame(100, kPeriod);
  session.syncActions();
  Archive saved = Archive::saver();
  session.fields(saved);

  SimulatedDevice fresh_device;
  Session fresh(fresh_device);
  build(fresh);
  Archive loader = Archive::loader(saved.bytes());
  fresh.fields(loader);
  loader.expectEnd();
  EXPECT_EQ(fresh.state(), XR_SESSION_STATE_FOCUSED);
  EXPECT_EQ(fresh.frameTime(), 100);
  EXPECT_EQ(fresh_device.state().head.position.y, 1.5F);
  const Action& grab = *fresh.findActionSet("play")->findAction("grab");
  EXPECT_EQ(fresh.getActionStateFloat(grab, Hand::right).currentState, 0.5F);
  EXPECT_EQ(fresh.getActionStateFloat(grab, Hand::right).lastChangeTime, 100);
  fresh.beginFrame();  // the frame under way goes on
  fresh.endFrame();
  EXPECT_EQ(drain(fresh).size(), 5U) << "events not polled yet came along";
  Archive again = Archive::saver();
  session.fields(again);
  EXPECT_EQ(again.bytes(), saved.bytes()) << "saving changes nothing";
}

TEST(Session, SavedStateOfOtherActionsIsRefused) {
  SimulatedDevice device;
  Session session(device);
  build(session);
  Archive saved = Archive::saver();
  session.fields(saved);
  Session none(device);
  Archive loader = Archive::loader(saved.bytes());
  EXPECT_EQ(errorOf<EngineError>([&] { none.fields(loader); }),
            "saved state: it has 1 actions, this session has 0");
  Session other(device);
  other.createActionSet("play").createAction("drop", XR_ACTION_TYPE_FLOAT_INPUT);
  Archive second = Archive::loader(saved.bytes());
  EXPECT_EQ(errorOf<EngineError>([&] { other.fields(second); }),
            "saved state: action 'grab' where this session has 'drop'");
}

}  // namespace
}  // namespace sim2vr::xr

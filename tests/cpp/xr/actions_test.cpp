// SPDX-License-Identifier: Apache-2.0
// What inputs make of actions (action.hpp), for our own games and for OpenXR programs alike.
#include "sim2vr/xr/action.hpp"
#include "support.hpp"

namespace sim2vr::xr {
namespace {

class Actions : public ::testing::Test {
 protected:
  Action action(XrActionType type, const std::vector<const char*>& paths) const {
    Action made;
    made.name = "action";
    made.type = type;
    made.set = &set_;
    for (const char* path : paths) EXPECT_TRUE(made.bind(*profile_.find(path))) << path;
    return made;
  }

  void sync(Action& action, XrTime time, const DeviceState& devices) const {
    Action* const actions[]{&action};
    const ActiveSet active[]{{&set_}};
    syncActions(actions, active, &devices, time);
  }

  const Profile& profile_ = *findProfile("/interaction_profiles/oculus/touch_controller");
  ActionSet set_{.name = "play"};
};

TEST_F(Actions, ReportChangesBetweenSyncs) {
  Action fire = action(XR_ACTION_TYPE_FLOAT_INPUT, {"/user/hand/right/input/trigger/value"});
  const ActionState& state = fire.state(Hand::right);
  EXPECT_FALSE(state.active) << "no sync yet";
  struct Row {
    XrTime time;
    float trigger;
    bool changed;
    XrTime last_change;
  };
  for (const Row& row : {Row{100, 0.0F, false, 0}, Row{200, 0.25F, true, 200},
                         Row{300, 0.25F, false, 200}, Row{400, 1.0F, true, 400}}) {
    sync(fire, row.time, pulled(row.trigger));
    EXPECT_TRUE(state.active) << row.time;
    EXPECT_EQ(state.value.x, row.trigger) << row.time;
    EXPECT_EQ(state.changed, row.changed) << row.time;
    EXPECT_EQ(state.last_change, row.last_change) << row.time;
  }
}

TEST_F(Actions, ANumberPressesFromItsMiddleOn) {
  Action fire = action(XR_ACTION_TYPE_BOOLEAN_INPUT, {"/user/hand/right/input/trigger/value"});
  for (const auto& [trigger, pressed] : {std::pair{0.49F, false}, {0.5F, true}, {0.9F, true}}) {
    sync(fire, 1, pulled(trigger));
    EXPECT_EQ(fire.state(Hand::right).pressed(), pressed) << trigger;
  }
  EXPECT_FALSE(fire.state(Hand::right).changed) << "still pressed";
}

TEST_F(Actions, ButtonsAndSticksOfBothHands) {
  Action jump = action(XR_ACTION_TYPE_BOOLEAN_INPUT,
                       {"/user/hand/left/input/x/click", "/user/hand/right/input/a/click"});
  Action move = action(XR_ACTION_TYPE_VECTOR2F_INPUT,
                       {"/user/hand/left/input/thumbstick", "/user/hand/right/input/thumbstick"});
  Action strafe = action(XR_ACTION_TYPE_FLOAT_INPUT, {"/user/hand/left/input/thumbstick/x"});
  DeviceState devices = pulled(0.0F);
  devices.hand(Hand::left) = activeController();
  devices.hand(Hand::left).x = true;
  devices.hand(Hand::left).thumbstick = {-0.5F, 0.25F};
  devices.hand(Hand::right).thumbstick = {0.0F, 0.75F};
  for (Action* each : {&jump, &move, &strafe}) sync(*each, 100, devices);
  EXPECT_TRUE(jump.state(Hand::left).pressed());
  EXPECT_FALSE(jump.state(Hand::right).pressed());
  EXPECT_TRUE(jump.states[kBothHands].pressed()) << "combined: or";
  EXPECT_EQ(move.state(Hand::left).value.x, -0.5F);
  EXPECT_EQ(move.states[kBothHands].value.y, 0.75F) << "combined: furthest from rest";
  EXPECT_EQ(strafe.state(Hand::left).value.x, -0.5F);
}

TEST_F(Actions, WithoutItsControllerOrItsSetAnActionIsNothing) {
  Action fire = action(XR_ACTION_TYPE_FLOAT_INPUT, {"/user/hand/right/input/trigger/value"});
  const ActionState& state = fire.state(Hand::right);
  Action* const actions[]{&fire};
  const DeviceState devices = pulled(0.5F);
  const ActiveSet left_only[]{{&set_, {true, false}}};
  for (const auto& away :
       {std::function<void()>([&] { sync(fire, 200, DeviceState{}); }),
        std::function<void()>([&] { syncActions(actions, {}, &devices, 200); }),
        std::function<void()>([&] { syncActions(actions, left_only, &devices, 200); })}) {
    sync(fire, 100, devices);
    ASSERT_TRUE(state.active);
    away();
    EXPECT_FALSE(state.active);
    EXPECT_EQ(state.value.x, 0.0F);
    EXPECT_FALSE(state.changed);
    EXPECT_EQ(state.last_change, 0);
    sync(fire, 300, devices);
    EXPECT_TRUE(state.changed) << "0 while it was away";
    EXPECT_EQ(state.last_change, 300);
  }
}

TEST_F(Actions, ASetOfHigherPriorityTakesTheInputSource) {
  Action shoot = action(XR_ACTION_TYPE_FLOAT_INPUT, {"/user/hand/right/input/trigger/value"});
  Action grab = action(XR_ACTION_TYPE_FLOAT_INPUT, {"/user/hand/right/input/squeeze/value"});
  Action choose = action(XR_ACTION_TYPE_BOOLEAN_INPUT, {"/user/hand/right/input/trigger/touch"});
  ActionSet menu{.name = "menu", .priority = 5};
  choose.set = &menu;
  Action* const actions[]{&shoot, &grab, &choose};
  const ActiveSet both[]{{&set_}, {&menu}};
  const DeviceState devices = pulled(1.0F);
  syncActions(actions, both, &devices, 100);
  EXPECT_FALSE(shoot.state(Hand::right).active);
  EXPECT_TRUE(grab.state(Hand::right).active);
  EXPECT_TRUE(choose.state(Hand::right).active);
  menu.priority = 0;
  syncActions(actions, both, &devices, 200);
  EXPECT_TRUE(shoot.state(Hand::right).active) << "equal sets share";
}

TEST_F(Actions, BindOnlyWhatFits) {
  Action fire = action(XR_ACTION_TYPE_FLOAT_INPUT, {});
  const auto bind = [&](const char* path) { return fire.bind(*profile_.find(path)); };
  EXPECT_FALSE(bind("/user/hand/right/input/thumbstick"));
  EXPECT_FALSE(bind("/user/hand/right/output/haptic"));
  EXPECT_FALSE(bind("/user/hand/right/input/system/click")) << "we have none";
  fire.hands = {false, true};
  EXPECT_FALSE(bind("/user/hand/left/input/trigger"));
  EXPECT_TRUE(bind("/user/hand/right/input/trigger"));
  EXPECT_TRUE(bind("/user/hand/right/input/trigger/value"));
  EXPECT_EQ(fire.bindings.size(), 1U) << "once";
}

TEST(Names, HaveLetters) {
  for (const char* good : {"a", "grab.left-2", "_"}) EXPECT_TRUE(isName(good)) << good;
  for (const char* bad : {"", ".", "..", "A", "a b", "a/b"}) EXPECT_FALSE(isName(bad)) << bad;
}

}  // namespace
}  // namespace sim2vr::xr

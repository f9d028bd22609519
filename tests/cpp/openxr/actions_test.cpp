// SPDX-License-Identifier: Apache-2.0
// Actions, their bindings and priorities, and haptics.
#include <atomic>
#include <cstring>
#include <thread>

#include "program.hpp"

namespace sim2vr::openxr::test {
namespace {

constexpr const char* kTouch = "/interaction_profiles/oculus/touch_controller";
constexpr const char* kIndex = "/interaction_profiles/valve/index_controller";
constexpr const char* kSimple = "/interaction_profiles/khr/simple_controller";

struct Actions : ::testing::Test {
  FakeHarness harness;
  Program program;
  XrActionSet set = XR_NULL_HANDLE;

  void start(const nlohmann::json& config = nlohmann::json::object()) {
    harness.sendConfig(config);
    ASSERT_EQ(program.create({"XR_MND_headless"}), XR_SUCCESS);
    harness.send(MessageKind::accepted);
    ASSERT_EQ(program.createSession(), XR_SUCCESS);
    ASSERT_EQ(program.begin(), XR_SUCCESS);
    harness.receiveJson(MessageKind::hello);
    harness.receiveJson(MessageKind::session);
    set = makeSet("game", 0);
  }
  XrActionSet makeSet(const char* name, std::uint32_t priority) {
    XrActionSetCreateInfo info{};
    info.type = XR_TYPE_ACTION_SET_CREATE_INFO;
    std::strcpy(info.actionSetName, name);
    std::strcpy(info.localizedActionSetName, name);
    info.priority = priority;
    XrActionSet made = XR_NULL_HANDLE;
    EXPECT_EQ(XR_CALL(program.instance, xrCreateActionSet)(program.instance, &info, &made),
              XR_SUCCESS);
    return made;
  }
  XrResult tryAction(XrActionSet owner, const char* name, XrActionType type, XrAction* made,
                     const std::vector<XrPath>& hands = {}) {
    XrActionCreateInfo info{};
    info.type = XR_TYPE_ACTION_CREATE_INFO;
    std::strcpy(info.actionName, name);
    std::strcpy(info.localizedActionName, name);
    info.actionType = type;
    info.countSubactionPaths = static_cast<std::uint32_t>(hands.size());
    info.subactionPaths = hands.data();
    return XR_CALL(program.instance, xrCreateAction)(owner, &info, made);
  }
  XrAction action(XrActionSet owner, const char* name, XrActionType type,
                  const std::vector<XrPath>& hands = {}) {
    XrAction made = XR_NULL_HANDLE;
    EXPECT_EQ(tryAction(owner, name, type, &made, hands), XR_SUCCESS);
    return made;
  }
  XrResult suggest(const char* profile,
                   const std::vector<std::pair<XrAction, const char*>>& bindings) {
    std::vector<XrActionSuggestedBinding> list;
    for (const auto& [bound, path] : bindings) list.push_back({bound, program.path(path)});
    const XrInteractionProfileSuggestedBinding info{
        XR_TYPE_INTERACTION_PROFILE_SUGGESTED_BINDING, nullptr, program.path(profile),
        static_cast<std::uint32_t>(list.size()), list.data()};
    return XR_CALL(program.instance, xrSuggestInteractionProfileBindings)(program.instance, &info);
  }
  XrResult attach(const std::vector<XrActionSet>& sets) {
    const XrSessionActionSetsAttachInfo info{XR_TYPE_SESSION_ACTION_SETS_ATTACH_INFO, nullptr,
                                             static_cast<std::uint32_t>(sets.size()), sets.data()};
    return XR_CALL(program.instance, xrAttachSessionActionSets)(program.session, &info);
  }
  XrResult sync(const std::vector<XrActiveActionSet>& sets) {
    const XrActionsSyncInfo info{XR_TYPE_ACTIONS_SYNC_INFO, nullptr,
                                 static_cast<std::uint32_t>(sets.size()), sets.data()};
    return XR_CALL(program.instance, xrSyncActions)(program.session, &info);
  }
  XrActionStateFloat number(XrAction of, XrPath hand = XR_NULL_PATH) {
    const XrActionStateGetInfo info{XR_TYPE_ACTION_STATE_GET_INFO, nullptr, of, hand};
    XrActionStateFloat state{};
    state.type = XR_TYPE_ACTION_STATE_FLOAT;
    EXPECT_EQ(XR_CALL(program.instance, xrGetActionStateFloat)(program.session, &info, &state),
              XR_SUCCESS);
    return state;
  }
  void frame(double trigger) {
    harness.sendStep(1, false, trigger);
    ASSERT_EQ(program.frame(), XR_SUCCESS);
  }
};

TEST_F(Actions, ATriggerIsANumberAndAButton) {
  start();
  const XrAction pull = action(set, "pull", XR_ACTION_TYPE_FLOAT_INPUT);
  const XrAction fire = action(set, "fire", XR_ACTION_TYPE_BOOLEAN_INPUT);
  ASSERT_EQ(suggest(kTouch, {{pull, "/user/hand/right/input/trigger/value"},
                             {fire, "/user/hand/right/input/trigger"}}),
            XR_SUCCESS);
  ASSERT_EQ(attach({set}), XR_SUCCESS);
  frame(0.75);
  ASSERT_EQ(sync({{set, XR_NULL_PATH}}), XR_SUCCESS);
  XrActionStateFloat value = number(pull);
  EXPECT_FLOAT_EQ(value.currentState, 0.75F);
  EXPECT_TRUE(value.isActive && value.changedSinceLastSync);
  EXPECT_EQ(value.lastChangeTime, 1'010'000'000);
  const XrActionStateGetInfo get{XR_TYPE_ACTION_STATE_GET_INFO, nullptr, fire, XR_NULL_PATH};
  XrActionStateBoolean pressed{};
  pressed.type = XR_TYPE_ACTION_STATE_BOOLEAN;
  EXPECT_EQ(XR_CALL(program.instance, xrGetActionStateBoolean)(program.session, &get, &pressed),
            XR_SUCCESS);
  EXPECT_EQ(pressed.currentState, XR_TRUE);
  frame(0.75);
  ASSERT_EQ(sync({{set, XR_NULL_PATH}}), XR_SUCCESS);
  value = number(pull);
  EXPECT_EQ(value.changedSinceLastSync, XR_FALSE);
  EXPECT_EQ(value.lastChangeTime, 1'010'000'000);
  // Of another type.
  XrActionStateFloat wrong{};
  wrong.type = XR_TYPE_ACTION_STATE_FLOAT;
  EXPECT_EQ(XR_CALL(program.instance, xrGetActionStateFloat)(program.session, &get, &wrong),
            XR_ERROR_ACTION_TYPE_MISMATCH);
}

TEST_F(Actions, ASetOfHigherPriorityTakesTheInputSource) {
  start();
  const XrActionSet menu = makeSet("menu", 5);
  const XrAction shoot = action(set, "shoot", XR_ACTION_TYPE_FLOAT_INPUT);
  const XrAction grab = action(set, "grab", XR_ACTION_TYPE_FLOAT_INPUT);
  const XrAction choose = action(menu, "choose", XR_ACTION_TYPE_BOOLEAN_INPUT);
  ASSERT_EQ(suggest(kIndex, {{shoot, "/user/hand/right/input/trigger/value"},
                             {grab, "/user/hand/right/input/squeeze/value"},
                             {choose, "/user/hand/right/input/trigger/click"}}),
            XR_SUCCESS);
  ASSERT_EQ(attach({set, menu}), XR_SUCCESS);
  frame(1.0);
  ASSERT_EQ(sync({{set, XR_NULL_PATH}, {menu, XR_NULL_PATH}}), XR_SUCCESS);
  EXPECT_EQ(number(shoot).isActive, XR_FALSE);
  EXPECT_FLOAT_EQ(number(shoot).currentState, 0.0F);
  EXPECT_EQ(number(grab).isActive, XR_TRUE);
  ASSERT_EQ(sync({{set, XR_NULL_PATH}}), XR_SUCCESS);
  EXPECT_EQ(number(shoot).isActive, XR_TRUE);
  EXPECT_FLOAT_EQ(number(shoot).currentState, 1.0F);
}

TEST_F(Actions, HandsAreToldApart) {
  start();
  const XrPath left = program.path("/user/hand/left");
  const XrPath right = program.path("/user/hand/right");
  const XrAction pull = action(set, "pull", XR_ACTION_TYPE_FLOAT_INPUT, {left, right});
  ASSERT_EQ(suggest(kSimple, {{pull, "/user/hand/left/input/select/click"},
                              {pull, "/user/hand/right/input/select/click"}}),
            XR_SUCCESS);
  ASSERT_EQ(attach({set}), XR_SUCCESS);
  frame(1.0);
  ASSERT_EQ(sync({{set, XR_NULL_PATH}}), XR_SUCCESS);
  EXPECT_EQ(number(pull, left).isActive, XR_FALSE);  // not tracked
  EXPECT_FLOAT_EQ(number(pull, right).currentState, 1.0F);
  EXPECT_FLOAT_EQ(number(pull).currentState, 1.0F);
  ASSERT_EQ(sync({{set, left}}), XR_SUCCESS);
  EXPECT_EQ(number(pull, right).isActive, XR_FALSE);
  EXPECT_EQ(sync({{set, program.path("/user/head")}}), XR_ERROR_PATH_UNSUPPORTED);
  EXPECT_EQ(sync({{set, 12345}}), XR_ERROR_PATH_INVALID);
}

TEST_F(Actions, TheControllersOwnProfileComesFirst) {
  start({{"profile", kIndex}});
  const XrAction pull = action(set, "pull", XR_ACTION_TYPE_FLOAT_INPUT);
  ASSERT_EQ(suggest(kTouch, {{pull, "/user/hand/right/input/squeeze/value"}}), XR_SUCCESS);
  ASSERT_EQ(suggest(kIndex, {{pull, "/user/hand/right/input/trigger/value"}}), XR_SUCCESS);
  ASSERT_EQ(attach({set}), XR_SUCCESS);
  frame(1.0);
  XrInteractionProfileState profile{XR_TYPE_INTERACTION_PROFILE_STATE, nullptr, 1};
  const auto current = XR_CALL(program.instance, xrGetCurrentInteractionProfile);
  ASSERT_EQ(current(program.session, program.path("/user/hand/right"), &profile), XR_SUCCESS);
  EXPECT_EQ(profile.interactionProfile, XR_NULL_PATH);  // not before the first sync
  ASSERT_EQ(sync({{set, XR_NULL_PATH}}), XR_SUCCESS);
  EXPECT_FLOAT_EQ(number(pull).currentState, 1.0F);
  ASSERT_EQ(current(program.session, program.path("/user/hand/right"), &profile), XR_SUCCESS);
  EXPECT_EQ(profile.interactionProfile, program.path(kIndex));
  EXPECT_EQ(current(program.session, program.path("/user/foot"), &profile),
            XR_ERROR_PATH_UNSUPPORTED);
  const XrBoundSourcesForActionEnumerateInfo info{XR_TYPE_BOUND_SOURCES_FOR_ACTION_ENUMERATE_INFO,
                                                  nullptr, pull};
  XrPath source = XR_NULL_PATH;
  std::uint32_t count = 0;
  ASSERT_EQ(XR_CALL(program.instance, xrEnumerateBoundSourcesForAction)(program.session, &info, 1,
                                                                        &count, &source),
            XR_SUCCESS);
  EXPECT_EQ(source, program.path("/user/hand/right/input/trigger/value"));
  const XrInputSourceLocalizedNameGetInfo name_info{XR_TYPE_INPUT_SOURCE_LOCALIZED_NAME_GET_INFO,
                                                    nullptr, source, 7};
  char name[80]{};
  ASSERT_EQ(XR_CALL(program.instance, xrGetInputSourceLocalizedName)(program.session, &name_info,
                                                                     80, &count, name),
            XR_SUCCESS);
  EXPECT_STREQ(name, "Right Hand Index Controller Trigger");
}

TEST_F(Actions, HapticsAreEventsWithTheFramesTime) {
  start();
  const XrAction buzz = action(set, "buzz", XR_ACTION_TYPE_VIBRATION_OUTPUT);
  ASSERT_EQ(suggest(kTouch, {{buzz, "/user/hand/right/output/haptic"}}), XR_SUCCESS);
  ASSERT_EQ(attach({set}), XR_SUCCESS);
  XrHapticVibration vibration{XR_TYPE_HAPTIC_VIBRATION, nullptr, 20'000'000, 90.0F, 0.5F};
  const auto* header = reinterpret_cast<const XrHapticBaseHeader*>(&vibration);
  const XrHapticActionInfo info{XR_TYPE_HAPTIC_ACTION_INFO, nullptr, buzz, XR_NULL_PATH};
  const auto apply = XR_CALL(program.instance, xrApplyHapticFeedback);
  EXPECT_EQ(apply(program.session, &info, header), XR_SESSION_NOT_FOCUSED);
  frame(0.0);
  harness.receiveAnswer();
  ASSERT_EQ(apply(program.session, &info, header), XR_SUCCESS);
  vibration.amplitude = 1.5F;
  EXPECT_EQ(apply(program.session, &info, header), XR_ERROR_VALIDATION_FAILURE);
  frame(0.0);
  const auto events = harness.receiveAnswer()["events"];
  ASSERT_EQ(events.size(), 1U);
  EXPECT_EQ(events[0]["hand"], "right");
  EXPECT_EQ(events[0]["amplitude"], 0.5);
  EXPECT_EQ(events[0]["frequency_hz"], 90.0);
  EXPECT_EQ(events[0]["duration_ns"], 20'000'000);
  EXPECT_EQ(events[0]["time_ns"], 1'010'000'000);
}

TEST_F(Actions, ThreadsUseASessionAtOnce) {
  start();
  const XrAction buzz = action(set, "buzz", XR_ACTION_TYPE_VIBRATION_OUTPUT);
  const XrAction pull = action(set, "pull", XR_ACTION_TYPE_FLOAT_INPUT);
  const XrAction hand = action(set, "hand", XR_ACTION_TYPE_POSE_INPUT);
  ASSERT_EQ(suggest(kTouch, {{buzz, "/user/hand/right/output/haptic"},
                             {pull, "/user/hand/right/input/trigger/value"},
                             {hand, "/user/hand/right/input/grip/pose"}}),
            XR_SUCCESS);
  ASSERT_EQ(attach({set}), XR_SUCCESS);
  const XrSpace stage = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_STAGE);
  frame(0.0);
  harness.receiveAnswer();
  constexpr int kTimes = 300;
  std::atomic<int> busy{3};
  std::thread vibrates([&] {
    const XrHapticVibration vibration{XR_TYPE_HAPTIC_VIBRATION, nullptr, 1, 0.0F, 0.5F};
    const XrHapticActionInfo info{XR_TYPE_HAPTIC_ACTION_INFO, nullptr, buzz, XR_NULL_PATH};
    for (int i = 0; i < kTimes; ++i) {
      EXPECT_EQ(
          XR_CALL(program.instance, xrApplyHapticFeedback)(
              program.session, &info, reinterpret_cast<const XrHapticBaseHeader*>(&vibration)),
          XR_SUCCESS);
    }
    --busy;
  });
  std::thread reads([&] {
    for (int i = 0; i < kTimes; ++i) {
      EXPECT_EQ(sync({{set, XR_NULL_PATH}}), XR_SUCCESS);
      const XrActionStateFloat state = number(pull);
      EXPECT_TRUE(state.currentState == 0.0F || state.currentState == 0.75F);
      program.states();
    }
    --busy;
  });
  std::thread locates([&] {
    const XrActionSpaceCreateInfo info{
        XR_TYPE_ACTION_SPACE_CREATE_INFO, nullptr, hand, XR_NULL_PATH, {{0, 0, 0, 1}, {0, 0, 0}}};
    for (int i = 0; i < kTimes; ++i) {
      XrSpace space = XR_NULL_HANDLE;
      EXPECT_EQ(XR_CALL(program.instance, xrCreateActionSpace)(program.session, &info, &space),
                XR_SUCCESS);
      XrSpaceLocation location{XR_TYPE_SPACE_LOCATION, nullptr, 0, {}};
      EXPECT_EQ(XR_CALL(program.instance, xrLocateSpace)(space, stage, 1, &location), XR_SUCCESS);
      EXPECT_EQ(XR_CALL(program.instance, xrDestroySpace)(space), XR_SUCCESS);
    }
    --busy;
  });
  int pulses = 0;
  for (bool last = false; !last;) {
    last = busy == 0;
    frame(0.75);
    const auto events = harness.receiveAnswer()["events"];
    for (const auto& event : events) pulses += event["kind"] == "haptic" ? 1 : 0;
  }
  for (std::thread* each : {&vibrates, &reads, &locates}) each->join();
  EXPECT_EQ(pulses, kTimes);
}

TEST_F(Actions, AnActionSpaceFollowsTheGrip) {
  start();
  const XrAction hand = action(set, "hand", XR_ACTION_TYPE_POSE_INPUT);
  ASSERT_EQ(suggest(kTouch, {{hand, "/user/hand/right/input/grip/pose"}}), XR_SUCCESS);
  ASSERT_EQ(attach({set}), XR_SUCCESS);
  const XrActionSpaceCreateInfo info{
      XR_TYPE_ACTION_SPACE_CREATE_INFO, nullptr, hand, XR_NULL_PATH, {{0, 0, 0, 1}, {0, 0.5F, 0}}};
  XrSpace space = XR_NULL_HANDLE;
  ASSERT_EQ(XR_CALL(program.instance, xrCreateActionSpace)(program.session, &info, &space),
            XR_SUCCESS);
  const XrSpace stage = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_STAGE);
  frame(0.0);
  frame(0.0);
  XrSpaceVelocity velocity{XR_TYPE_SPACE_VELOCITY, nullptr, 0, {}, {}};
  XrSpaceLocation location{XR_TYPE_SPACE_LOCATION, &velocity, 9, {}};
  const auto locate = XR_CALL(program.instance, xrLocateSpace);
  ASSERT_EQ(locate(space, stage, harness.latest(), &location), XR_SUCCESS);
  EXPECT_EQ(location.locationFlags, 0U);  // nothing was synced
  ASSERT_EQ(sync({{set, XR_NULL_PATH}}), XR_SUCCESS);
  ASSERT_EQ(locate(space, stage, harness.latest(), &location), XR_SUCCESS);
  EXPECT_EQ(location.locationFlags, 15U);
  // The app's frame looks along +z, OpenXR's along -z.
  EXPECT_FLOAT_EQ(location.pose.position.z, -0.6F);
  EXPECT_FLOAT_EQ(location.pose.position.y, 1.5F);
  EXPECT_NEAR(velocity.linearVelocity.z, -10.0F, 1e-4F);
}

TEST_F(Actions, AHandThatNothingIsBoundToIsInactive) {
  start();
  const XrPath right = program.path("/user/hand/right");
  const XrPath gamepad = program.path("/user/gamepad");
  const XrAction pull = action(set, "pull", XR_ACTION_TYPE_FLOAT_INPUT, {right, gamepad});
  const XrAction hand = action(set, "hand", XR_ACTION_TYPE_POSE_INPUT);
  ASSERT_EQ(suggest(kTouch, {{pull, "/user/hand/right/input/trigger/value"},
                             {hand, "/user/hand/left/input/grip/pose"}}),
            XR_SUCCESS);
  ASSERT_EQ(attach({set}), XR_SUCCESS);
  frame(1.0);
  ASSERT_EQ(sync({{set, XR_NULL_PATH}}), XR_SUCCESS);
  EXPECT_FLOAT_EQ(number(pull, right).currentState, 1.0F);
  EXPECT_EQ(number(pull, gamepad).isActive, XR_FALSE);
  EXPECT_FLOAT_EQ(number(pull, gamepad).currentState, 0.0F);
  // The left hand is not tracked: not even in itself is its space anywhere.
  const XrActionSpaceCreateInfo info{
      XR_TYPE_ACTION_SPACE_CREATE_INFO, nullptr, hand, XR_NULL_PATH, {{0, 0, 0, 1}, {0, 0, 0}}};
  XrSpace space = XR_NULL_HANDLE;
  ASSERT_EQ(XR_CALL(program.instance, xrCreateActionSpace)(program.session, &info, &space),
            XR_SUCCESS);
  XrSpaceLocation location{XR_TYPE_SPACE_LOCATION, nullptr, 9, {}};
  ASSERT_EQ(XR_CALL(program.instance, xrLocateSpace)(space, space, harness.latest(), &location),
            XR_SUCCESS);
  EXPECT_EQ(location.locationFlags, 0U);
}

TEST_F(Actions, WrongUseHasItsCodes) {
  start();
  const XrAction pull = action(set, "pull", XR_ACTION_TYPE_FLOAT_INPUT);
  XrAction made = XR_NULL_HANDLE;
  EXPECT_EQ(tryAction(set, "pull", XR_ACTION_TYPE_FLOAT_INPUT, &made), XR_ERROR_NAME_DUPLICATED);
  EXPECT_EQ(tryAction(set, "", XR_ACTION_TYPE_FLOAT_INPUT, &made), XR_ERROR_NAME_INVALID);
  EXPECT_EQ(tryAction(set, "A", XR_ACTION_TYPE_FLOAT_INPUT, &made), XR_ERROR_PATH_FORMAT_INVALID);
  EXPECT_EQ(tryAction(set, "b", static_cast<XrActionType>(77), &made), XR_ERROR_VALIDATION_FAILURE);
  const XrPath left = program.path("/user/hand/left");
  EXPECT_EQ(tryAction(set, "c", XR_ACTION_TYPE_FLOAT_INPUT, &made, {left, left}),
            XR_ERROR_PATH_UNSUPPORTED);
  EXPECT_EQ(suggest("/interaction_profiles/none/such", {{pull, "/user/hand/left/input/a"}}),
            XR_ERROR_PATH_UNSUPPORTED);
  EXPECT_EQ(suggest(kTouch, {{pull, "/user/hand/left/input/a/click"}}), XR_ERROR_PATH_UNSUPPORTED);
  EXPECT_EQ(suggest(kTouch, {}), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(tryAction(set, "..", XR_ACTION_TYPE_FLOAT_INPUT, &made), XR_ERROR_PATH_FORMAT_INVALID);
  const XrAction hand = action(set, "hand", XR_ACTION_TYPE_POSE_INPUT);
  EXPECT_EQ(suggest(kTouch, {{hand, "/user/hand/left/input/grip_surface/pose"}}),
            XR_ERROR_PATH_UNSUPPORTED);  // since 1.1
  EXPECT_EQ(sync({{set, XR_NULL_PATH}}), XR_ERROR_ACTIONSET_NOT_ATTACHED);
  EXPECT_EQ(attach({}), XR_ERROR_VALIDATION_FAILURE);
  ASSERT_EQ(attach({set}), XR_SUCCESS);
  EXPECT_EQ(attach({set}), XR_ERROR_ACTIONSETS_ALREADY_ATTACHED);
  EXPECT_EQ(tryAction(set, "late", XR_ACTION_TYPE_FLOAT_INPUT, &made),
            XR_ERROR_ACTIONSETS_ALREADY_ATTACHED);
  EXPECT_EQ(suggest(kTouch, {{pull, "/user/hand/left/input/x/click"}}),
            XR_ERROR_ACTIONSETS_ALREADY_ATTACHED);
  EXPECT_EQ(sync({{set, XR_NULL_PATH}}), XR_SESSION_NOT_FOCUSED);
  EXPECT_EQ(XR_CALL(program.instance, xrDestroyActionSet)(set), XR_SUCCESS);
  EXPECT_EQ(XR_CALL(program.instance, xrDestroyAction)(pull), XR_ERROR_HANDLE_INVALID);
}

}  // namespace
}  // namespace sim2vr::openxr::test

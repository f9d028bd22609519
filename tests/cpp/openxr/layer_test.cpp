// SPDX-License-Identifier: Apache-2.0
// The recording layer over our runtime: what the harness sent stands in the file.
#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "calls.hpp"
#include "layer_loader.hpp"
#include "own_folder.hpp"
#include "program.hpp"

namespace sim2vr::openxr::test {
namespace {

XrResult createBelow(const XrInstanceCreateInfo* info, const CreateInfo*, XrInstance* instance) {
  return XR_CALL(XR_NULL_HANDLE, xrCreateInstance)(info, instance);
}

/// A program above the layer.
struct Recorded : ::testing::Test {
  sim2vr::testing::OwnFolder folder;
  std::filesystem::path file = folder / "round.jsonl";
  FakeHarness harness;
  Program program;
  LayerRequest layer;

  template <class F>
  F above(const char* name) {
    PFN_xrVoidFunction found = nullptr;
    EXPECT_EQ(layer.get(program.instance, name, &found), XR_SUCCESS) << name;
    return reinterpret_cast<F>(found);
  }
  void SetUp() override {
    ::setenv("SIM2VR_OPENXR_RECORD", file.c_str(), 1);
    layer = openLayer();
    XrInstanceCreateInfo info{};
    info.type = XR_TYPE_INSTANCE_CREATE_INFO;
    std::strcpy(info.applicationInfo.applicationName, "recorded");
    info.applicationInfo.apiVersion = kVersion10;
    const char* extensions[]{"XR_MND_headless"};
    info.enabledExtensionCount = 1;
    info.enabledExtensionNames = extensions;
    NextInfo next;
    next.get = &calls::xrGetInstanceProcAddr;
    next.create = &createBelow;
    CreateInfo create;
    create.next = &next;
    harness.sendConfig();
    ASSERT_EQ(layer.create(&info, &create, &program.instance), XR_SUCCESS);
    const XrSystemGetInfo form{XR_TYPE_SYSTEM_GET_INFO, nullptr,
                               XR_FORM_FACTOR_HEAD_MOUNTED_DISPLAY};
    ASSERT_EQ(above<PFN_xrGetSystem>("xrGetSystem")(program.instance, &form, &program.system),
              XR_SUCCESS);
    const XrSessionCreateInfo session{XR_TYPE_SESSION_CREATE_INFO, nullptr, 0, program.system};
    harness.send(MessageKind::accepted);
    ASSERT_EQ(
        above<PFN_xrCreateSession>("xrCreateSession")(program.instance, &session, &program.session),
        XR_SUCCESS);
    ASSERT_EQ(program.begin(), XR_SUCCESS);
  }
  void TearDown() override {
    EXPECT_EQ(above<PFN_xrDestroyInstance>("xrDestroyInstance")(program.instance), XR_SUCCESS);
    program.instance = XR_NULL_HANDLE;
    ::unsetenv("SIM2VR_OPENXR_RECORD");
  }
  /// Suggests one binding of the program's own, and attaches.
  void attachActions() {
    XrActionSetCreateInfo set_info{};
    set_info.type = XR_TYPE_ACTION_SET_CREATE_INFO;
    std::strcpy(set_info.actionSetName, "game");
    std::strcpy(set_info.localizedActionSetName, "game");
    XrActionSet set = XR_NULL_HANDLE;
    ASSERT_EQ(above<PFN_xrCreateActionSet>("xrCreateActionSet")(program.instance, &set_info, &set),
              XR_SUCCESS);
    XrActionCreateInfo action_info{};
    action_info.type = XR_TYPE_ACTION_CREATE_INFO;
    std::strcpy(action_info.actionName, "pull");
    std::strcpy(action_info.localizedActionName, "pull");
    action_info.actionType = XR_ACTION_TYPE_FLOAT_INPUT;
    XrAction action = XR_NULL_HANDLE;
    ASSERT_EQ(above<PFN_xrCreateAction>("xrCreateAction")(set, &action_info, &action), XR_SUCCESS);
    const XrActionSuggestedBinding binding{action,
                                           program.path("/user/hand/right/input/trigger/value")};
    const XrInteractionProfileSuggestedBinding suggested{
        XR_TYPE_INTERACTION_PROFILE_SUGGESTED_BINDING, nullptr,
        program.path("/interaction_profiles/oculus/touch_controller"), 1, &binding};
    ASSERT_EQ(above<PFN_xrSuggestInteractionProfileBindings>("xrSuggestInteractionProfileBindings")(
                  program.instance, &suggested),
              XR_SUCCESS);
    const XrSessionActionSetsAttachInfo attach{XR_TYPE_SESSION_ACTION_SETS_ATTACH_INFO, nullptr, 1,
                                               &set};
    ASSERT_EQ(
        above<PFN_xrAttachSessionActionSets>("xrAttachSessionActionSets")(program.session, &attach),
        XR_SUCCESS);
  }
  void sync() {
    const XrActionsSyncInfo info{XR_TYPE_ACTIONS_SYNC_INFO, nullptr, 0, nullptr};
    ASSERT_EQ(above<PFN_xrSyncActions>("xrSyncActions")(program.session, &info), XR_SUCCESS);
  }
  std::vector<nlohmann::json> written() {
    EXPECT_EQ(above<PFN_xrDestroySession>("xrDestroySession")(program.session), XR_SUCCESS);
    std::ifstream stream(file);
    std::vector<nlohmann::json> lines;
    for (std::string line; std::getline(stream, line);) {
      lines.push_back(nlohmann::json::parse(line));
    }
    return lines;
  }
  void frame(double trigger, bool syncs = true) {
    harness.sendStep(1, false, trigger);
    XrFrameState state{XR_TYPE_FRAME_STATE, nullptr, 0, 0, 0};
    ASSERT_EQ(above<PFN_xrWaitFrame>("xrWaitFrame")(program.session, nullptr, &state), XR_SUCCESS);
    ASSERT_EQ(above<PFN_xrBeginFrame>("xrBeginFrame")(program.session, nullptr), XR_SUCCESS);
    if (syncs) sync();
    const XrFrameEndInfo end{XR_TYPE_FRAME_END_INFO,           nullptr, state.predictedDisplayTime,
                             XR_ENVIRONMENT_BLEND_MODE_OPAQUE, 0,       nullptr};
    ASSERT_EQ(above<PFN_xrEndFrame>("xrEndFrame")(program.session, &end), XR_SUCCESS);
  }
};

TEST_F(Recorded, FramesHavePosesAndInputs) {
  attachActions();
  frame(0.0);
  frame(0.75);
  const auto lines = written();
  ASSERT_EQ(lines.size(), 3U);
  EXPECT_EQ(lines[0]["format"], "sim2vr-session");
  EXPECT_EQ(lines[0]["app"]["name"], "recorded");
  EXPECT_EQ(lines[1]["t"], 0);
  EXPECT_EQ(lines[2]["t"], 10'000'000);
  // As FakeHarness sent them, in the app's frame.
  EXPECT_FLOAT_EQ(lines[2]["head"][0], 1.0F);
  EXPECT_FLOAT_EQ(lines[2]["right"]["grip"][2], 0.6F);
  EXPECT_FLOAT_EQ(lines[2]["right"]["inputs"][0], 0.75F);
  EXPECT_FALSE(lines[2].contains("left"));
}

TEST_F(Recorded, InputsReadAfterAFrameAreThatFrames) {
  // As hello_xr does: it reads inputs between two frames.
  attachActions();
  frame(0.0, false);
  sync();
  frame(0.75, false);
  sync();
  const auto lines = written();
  ASSERT_EQ(lines.size(), 3U);
  EXPECT_FLOAT_EQ(lines[1]["right"]["inputs"][0], 0.0F);
  EXPECT_FLOAT_EQ(lines[2]["right"]["inputs"][0], 0.75F);
}

}  // namespace
}  // namespace sim2vr::openxr::test

// SPDX-License-Identifier: Apache-2.0
// The recording layer in a program whose memory runs out: what the program gets from its calls, and
// what the runtime gets of the program's, is as without the layer.
#include <dlfcn.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "api.hpp"
#include "failing_memory.hpp"
#include "layer/layer.hpp"
#include "layer_loader.hpp"
#include "own_folder.hpp"

namespace sim2vr::openxr::test {
namespace {

constexpr long kEnough = std::numeric_limits<long>::max() / 2;

/// A runtime that allocates nothing. It writes down the calls with the program's handles; those it
/// gave itself to others are the layer's.
struct Call {
  const char* name;
  std::uint64_t handle;
  std::uint64_t what;
  bool operator==(const Call& other) const {
    return std::strcmp(name, other.name) == 0 && handle == other.handle && what == other.what;
  }
};
struct FakeRuntime {
  std::array<Call, 400> calls{};
  std::size_t count = 0;
  std::uint64_t next_own = 1000;  // handles that the layer asks for
  std::uint64_t instances = 0;
  std::uint64_t sessions = 0;
  std::uint64_t located = 0;
  const char* missing = "";
} fake;

template <class Handle>
Handle handleOf(std::uint64_t number) {
  return reinterpret_cast<Handle>(number);
}
template <class Handle>
XrResult called(const char* name, Handle handle, std::uint64_t what, XrResult result = XR_SUCCESS) {
  fake.calls.at(fake.count++) = {name, reinterpret_cast<std::uint64_t>(handle), what};
  return result;
}

XrResult destroyInstance(XrInstance instance) { return called("destroyInstance", instance, 0); }
XrResult createSession(XrInstance instance, const XrSessionCreateInfo*, XrSession* session) {
  *session = handleOf<XrSession>(100 + ++fake.sessions);
  return called("createSession", instance, 0);
}
XrResult destroySession(XrSession session) { return called("destroySession", session, 0); }
/// The program's is the first binding; what is suggested with and without ours counts once.
XrResult suggest(XrInstance instance, const XrInteractionProfileSuggestedBinding* info) {
  return called("suggest", instance,
                reinterpret_cast<std::uint64_t>(info->suggestedBindings->action));
}
XrResult attach(XrSession session, const XrSessionActionSetsAttachInfo* info) {
  return called("attach", session, reinterpret_cast<std::uint64_t>(info->actionSets[0]));
}
XrResult sync(XrSession session, const XrActionsSyncInfo* info) {
  return called("sync", session,
                reinterpret_cast<std::uint64_t>(info->activeActionSets[0].actionSet),
                XR_SESSION_NOT_FOCUSED);
}
XrResult waitFrame(XrSession session, const XrFrameWaitInfo*, XrFrameState* state) {
  state->predictedDisplayTime += 10'000'000;
  return called("waitFrame", session, 0);
}
XrResult endFrame(XrSession session, const XrFrameEndInfo* info) {
  return called("endFrame", session, static_cast<std::uint64_t>(info->displayTime));
}
XrResult vibrate(XrSession session, const XrHapticActionInfo* info, const XrHapticBaseHeader*) {
  return called("vibrate", session, reinterpret_cast<std::uint64_t>(info->action));
}
XrResult stringToPath(XrInstance, const char* text, XrPath* path) {
  *path = std::strcmp(text, "/user/hand/left") == 0 ? 1 : 2;
  return XR_SUCCESS;
}
XrResult pathToString(XrInstance, XrPath path, std::uint32_t size, std::uint32_t* length,
                      char* text) {
  const char* name = path == 3   ? "/interaction_profiles/oculus/touch_controller"
                     : path == 1 ? "/user/hand/left"
                                 : "/user/hand/right";
  std::snprintf(text, size, "%s", name);
  *length = static_cast<std::uint32_t>(std::strlen(name) + 1);
  return XR_SUCCESS;
}
XrResult createActionSet(XrInstance, const XrActionSetCreateInfo*, XrActionSet* set) {
  *set = handleOf<XrActionSet>(++fake.next_own);
  return XR_SUCCESS;
}
XrResult createAction(XrActionSet, const XrActionCreateInfo*, XrAction* action) {
  *action = handleOf<XrAction>(++fake.next_own);
  return XR_SUCCESS;
}
XrResult createActionSpace(XrSession, const XrActionSpaceCreateInfo*, XrSpace* space) {
  *space = handleOf<XrSpace>(++fake.next_own);
  return XR_SUCCESS;
}
XrResult createReferenceSpace(XrSession, const XrReferenceSpaceCreateInfo*, XrSpace* space) {
  *space = handleOf<XrSpace>(++fake.next_own);
  return XR_SUCCESS;
}
XrResult locateSpace(XrSpace, XrSpace, XrTime, XrSpaceLocation* location) {
  ++fake.located;
  location->locationFlags =
      XR_SPACE_LOCATION_ORIENTATION_VALID_BIT | XR_SPACE_LOCATION_POSITION_VALID_BIT;
  location->pose = {{0.0F, 0.0F, 0.0F, 1.0F}, {0.0F, 1.6F, 0.0F}};
  return XR_SUCCESS;
}
XrResult getBoolean(XrSession, const XrActionStateGetInfo*, XrActionStateBoolean*) {
  return XR_SUCCESS;
}
XrResult getFloat(XrSession, const XrActionStateGetInfo*, XrActionStateFloat* state) {
  state->currentState = 0.5F;
  return XR_SUCCESS;
}
XrResult getVector(XrSession, const XrActionStateGetInfo*, XrActionStateVector2f*) {
  return XR_SUCCESS;
}
XrResult boundSources(XrSession, const XrBoundSourcesForActionEnumerateInfo*, std::uint32_t,
                      std::uint32_t* count, XrPath* paths) {
  *count = 1;
  paths[0] = 2;
  return XR_SUCCESS;
}

XrResult getFunction(XrInstance, const char* name, PFN_xrVoidFunction* function) {
  struct Named {
    const char* name;
    PFN_xrVoidFunction function;
  };
  const auto plain = [](auto each) { return reinterpret_cast<PFN_xrVoidFunction>(each); };
  static const Named kFunctions[]{{"xrDestroyInstance", plain(&destroyInstance)},
                                  {"xrCreateSession", plain(&createSession)},
                                  {"xrDestroySession", plain(&destroySession)},
                                  {"xrSuggestInteractionProfileBindings", plain(&suggest)},
                                  {"xrAttachSessionActionSets", plain(&attach)},
                                  {"xrSyncActions", plain(&sync)},
                                  {"xrWaitFrame", plain(&waitFrame)},
                                  {"xrEndFrame", plain(&endFrame)},
                                  {"xrApplyHapticFeedback", plain(&vibrate)},
                                  {"xrStringToPath", plain(&stringToPath)},
                                  {"xrPathToString", plain(&pathToString)},
                                  {"xrCreateActionSet", plain(&createActionSet)},
                                  {"xrCreateAction", plain(&createAction)},
                                  {"xrCreateActionSpace", plain(&createActionSpace)},
                                  {"xrCreateReferenceSpace", plain(&createReferenceSpace)},
                                  {"xrLocateSpace", plain(&locateSpace)},
                                  {"xrGetActionStateBoolean", plain(&getBoolean)},
                                  {"xrGetActionStateFloat", plain(&getFloat)},
                                  {"xrGetActionStateVector2f", plain(&getVector)},
                                  {"xrEnumerateBoundSourcesForAction", plain(&boundSources)}};
  *function = nullptr;
  for (const Named& each : kFunctions) {
    if (std::strcmp(each.name, name) == 0 && std::strcmp(fake.missing, name) != 0) {
      *function = each.function;
      return XR_SUCCESS;
    }
  }
  return XR_ERROR_FUNCTION_UNSUPPORTED;
}
XrResult createInstance(const XrInstanceCreateInfo*, const CreateInfo*, XrInstance* instance) {
  *instance = handleOf<XrInstance>(++fake.instances);
  return called("createInstance", *instance, 0);
}

/// Results of a program's calls, in order. It allocates nothing.
struct Results {
  std::array<XrResult, 100> each{};
  std::size_t count = 0;
  void add(XrResult result) { each.at(count++) = result; }
};

struct Chain {
  PFN_xrGetInstanceProcAddr get;
  Create create;
};

template <class F>
F found(const Chain& chain, XrInstance instance, const char* name, Results& results) {
  PFN_xrVoidFunction function = nullptr;
  results.add(chain.get(instance, name, &function));
  return reinterpret_cast<F>(function);
}
#define FOUND(name) found<PFN_##name>(chain, instance, #name, results)

/// What programs do, from the instance to its end.
void play(const Chain& chain, Results& results, int frames = 3) {
  XrInstanceCreateInfo info{};
  info.type = XR_TYPE_INSTANCE_CREATE_INFO;
  std::strcpy(info.applicationInfo.applicationName, "a name that is too long for a short string");
  NextInfo next;
  next.get = &getFunction;
  next.create = &createInstance;
  CreateInfo create;
  create.next = &next;
  XrInstance instance = XR_NULL_HANDLE;
  results.add(chain.create(&info, &create, &instance));
  const XrSessionCreateInfo session_info{XR_TYPE_SESSION_CREATE_INFO, nullptr, 0, 1};
  XrSession session = XR_NULL_HANDLE;
  results.add(FOUND(xrCreateSession)(instance, &session_info, &session));
  const XrActionSuggestedBinding binding{handleOf<XrAction>(7), 9};
  const XrInteractionProfileSuggestedBinding suggested{
      XR_TYPE_INTERACTION_PROFILE_SUGGESTED_BINDING, nullptr, 3, 1, &binding};
  results.add(FOUND(xrSuggestInteractionProfileBindings)(instance, &suggested));
  const auto set = handleOf<XrActionSet>(8);
  const XrSessionActionSetsAttachInfo attached{XR_TYPE_SESSION_ACTION_SETS_ATTACH_INFO, nullptr, 1,
                                               &set};
  results.add(FOUND(xrAttachSessionActionSets)(session, &attached));
  XrFrameState state{XR_TYPE_FRAME_STATE, nullptr, 0, 0, 0};
  const auto wait = FOUND(xrWaitFrame);
  const auto sync_actions = FOUND(xrSyncActions);
  const auto end = FOUND(xrEndFrame);
  const auto shake = FOUND(xrApplyHapticFeedback);
  for (int i = 0; i < frames; ++i) {
    results.add(wait(session, nullptr, &state));
    const XrActiveActionSet active{set, XR_NULL_PATH};
    const XrActionsSyncInfo synced{XR_TYPE_ACTIONS_SYNC_INFO, nullptr, 1, &active};
    results.add(sync_actions(session, &synced));
    const XrHapticActionInfo shaken{XR_TYPE_HAPTIC_ACTION_INFO, nullptr, handleOf<XrAction>(7),
                                    XR_NULL_PATH};
    const XrHapticVibration vibration{XR_TYPE_HAPTIC_VIBRATION, nullptr, 1000, 0.0F, 1.0F};
    results.add(shake(session, &shaken, reinterpret_cast<const XrHapticBaseHeader*>(&vibration)));
    const XrFrameEndInfo ended{
        XR_TYPE_FRAME_END_INFO,           nullptr, state.predictedDisplayTime,
        XR_ENVIRONMENT_BLEND_MODE_OPAQUE, 0,       nullptr};
    results.add(end(session, &ended));
  }
  results.add(FOUND(xrDestroySession)(session));
  results.add(FOUND(xrDestroyInstance)(instance));
}

std::vector<Call> calls() { return {fake.calls.begin(), fake.calls.begin() + fake.count}; }

struct HarmlessLayer : ::testing::Test {
  sim2vr::testing::OwnFolder folder;
  std::filesystem::path file = folder / "a_name_longer_than_a_short_string.jsonl";
  Chain with;
  Chain without{&getFunction, &createInstance};
  Results bare;
  std::vector<Call> bare_calls;

  void SetUp() override {
    ::setenv("SIM2VR_OPENXR_RECORD", file.c_str(), 1);
    const LayerRequest layer = openLayer();
    with = {layer.get, layer.create};
    fake = {};
    play(without, bare);
    bare_calls = calls();
    ASSERT_EQ(bare_calls.size(), 18U);
    fake = {};
  }
  void TearDown() override { ::unsetenv("SIM2VR_OPENXR_RECORD"); }
  void expectAsWithout(const Results& results, long after) {
    ASSERT_EQ(results.count, bare.count);
    for (std::size_t i = 0; i < results.count; ++i) {
      EXPECT_EQ(results.each[i], bare.each[i]) << "result " << i << ", memory for " << after;
    }
    EXPECT_EQ(calls(), bare_calls) << "memory for " << after;
  }
  std::vector<nlohmann::json> lines() const {
    std::ifstream stream(file);
    std::vector<nlohmann::json> parsed;
    for (std::string line; std::getline(stream, line);) {
      parsed.push_back(nlohmann::json::parse(line));
    }
    return parsed;
  }
};

TEST_F(HarmlessLayer, CallsAreAsWithoutItWhereverMemoryRunsOut) {
  long after = 0;
  bool ran_out = true;
  while (ran_out) {
    ASSERT_LT(after, 5000);
    std::filesystem::remove(file);
    fake = {};
    Results results;
    {
      const FailingMemory memory(after);
      play(with, results);
      ran_out = FailingMemory::ranOut();
    }
    expectAsWithout(results, after);
    if (::testing::Test::HasFailure()) return;
    ++after;
  }
  EXPECT_GT(after, 10);           // each of its allocations failed once
  EXPECT_EQ(lines().size(), 7U);  // with enough of it: a header, frames, vibrations
}

TEST_F(HarmlessLayer, FramesAllocateNothingInTheProgramsThread) {
  Results results;
  const auto allocations = [&](int frames) {
    std::filesystem::remove(file);
    fake = {};
    results = {};
    const FailingMemory memory(kEnough);
    play(with, results, frames);
    return FailingMemory::ofThisThread();
  };
  allocations(1);  // tables that are made once
  EXPECT_EQ(allocations(20), allocations(1));
}

TEST_F(HarmlessLayer, WhatAFullDiskDidNotTakeIsCounted) {
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  Results results;
  ::testing::internal::CaptureStderr();
  const rlimit small{300, before.rlim_max};  // the header and less than two frames
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  play(with, results);
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
  const std::string said = ::testing::internal::GetCapturedStderr();
  EXPECT_NE(said.find("the recording lacks 3 frames and 3 vibrations: writing the file: "
                      "File too large"),
            std::string::npos)
      << said;
  EXPECT_EQ(lines().size(), 1U);  // whole lines only
  expectAsWithout(results, 0);
}

TEST_F(HarmlessLayer, AnyNameOfAProgramIsWrittenAsText) {
  for (const auto& [name, expected] :
       std::map<std::string, std::string>{{"say \"hi\" \\ \n", "say \"hi\" \\ ?"},
                                          {"Gr\xC3\xBC\xC3\x9F"
                                           "e",
                                           "Gr\xC3\xBC\xC3\x9F"
                                           "e"},
                                          {"Gr\xFC"
                                           "n\xE2\x82",
                                           "Gr?n??"}}) {
    std::filesystem::remove(file);
    layer::Recording(::open(file.c_str(), O_WRONLY | O_CREAT, 0600), name);
    EXPECT_EQ(lines().at(0)["app"]["name"], expected);
  }
}

TEST_F(HarmlessLayer, InstancesComeAndGoAndLiveSideBySide) {
  for (int i = 0; i < 40; ++i) {  // more than it holds at a time
    std::filesystem::remove(file);
    fake = {};
    Results results;
    play(with, results);
    expectAsWithout(results, i);
    EXPECT_EQ(lines().size(), 7U);
  }
  NextInfo next;
  next.get = &getFunction;
  next.create = &createInstance;
  CreateInfo create;
  create.next = &next;
  XrInstanceCreateInfo info{};
  info.type = XR_TYPE_INSTANCE_CREATE_INFO;
  std::array<XrInstance, 20> instances{};
  std::array<XrSession, 20> sessions{};
  const XrSessionCreateInfo session_info{XR_TYPE_SESSION_CREATE_INFO, nullptr, 0, 1};
  const auto& chain = with;
  Results results;
  for (std::size_t i = 0; i < instances.size(); ++i) {
    XrInstance& instance = instances[i];
    ASSERT_EQ(with.create(&info, &create, &instance), XR_SUCCESS);
    ASSERT_EQ(FOUND(xrCreateSession)(instance, &session_info, &sessions[i]), XR_SUCCESS);
  }
  for (std::size_t i = 0; i < instances.size(); ++i) {
    const XrInstance instance = instances[i];
    fake.count = 0;
    EXPECT_EQ(FOUND(xrDestroySession)(sessions[i]), XR_SUCCESS);
    EXPECT_EQ(FOUND(xrDestroyInstance)(instance), XR_SUCCESS);
    const auto session = reinterpret_cast<std::uint64_t>(sessions[i]);
    const auto owner = reinterpret_cast<std::uint64_t>(instance);
    EXPECT_EQ(calls(),
              (std::vector<Call>{{"destroySession", session, 0}, {"destroyInstance", owner, 0}}));
  }
}

TEST_F(HarmlessLayer, ARuntimeWithoutAFunctionIsNotRecorded) {
  for (const char* name : {"xrLocateSpace", "xrEnumerateBoundSourcesForAction"}) {
    fake = {};
    fake.missing = name;
    Results results;
    play(with, results);
    expectAsWithout(results, 0);
    EXPECT_FALSE(std::filesystem::exists(file));
  }
  PFN_xrVoidFunction function = nullptr;
  EXPECT_NE(with.get(handleOf<XrInstance>(99), "xrNoSuchFunction", &function), XR_SUCCESS);
  EXPECT_EQ(function, nullptr);
}

TEST(RecordingQueue, AFileThatIsNotTakenKeepsNobodyWaiting) {
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  std::string text;
  const auto start = std::chrono::steady_clock::now();
  constexpr std::uint64_t kFrames = 5000;  // far more than the pipe and the queue hold
  ::testing::internal::CaptureStderr();
  std::thread reader;
  {
    layer::Recording recording(ends[1], "app");
    layer::EndedFrame frame;
    for (std::uint64_t i = 0; i < kFrames; ++i) {
      frame.time = static_cast<XrTime>(1 + i);
      recording.add(frame);
    }
    EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(5));
    reader = std::thread([&] {
      char part[4096];
      for (ssize_t n = 0; (n = ::read(ends[0], part, sizeof part)) > 0;) text.append(part, n);
    });
  }
  reader.join();
  ::close(ends[0]);
  std::uint64_t written = 0;
  std::uint64_t lost = 0;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) {
    const auto entry = nlohmann::json::parse(line);
    if (entry.contains("head")) ++written;
    if (entry.value("event", "") == "lost") {
      lost += entry["data"]["frames"].get<std::uint64_t>();
    }
  }
  EXPECT_GE(written, layer::Recording::kWaiting);
  EXPECT_GT(lost, 0U);
  EXPECT_EQ(written + lost, kFrames);
  const std::string said = ::testing::internal::GetCapturedStderr();
  EXPECT_NE(said.find("lacks " + std::to_string(lost) + " frames"), std::string::npos) << said;
}

}  // namespace
}  // namespace sim2vr::openxr::test

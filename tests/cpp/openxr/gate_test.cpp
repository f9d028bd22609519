// SPDX-License-Identifier: Apache-2.0
// Lockstep: the harness's steps, the program's frames, and how either may fail.
#include <sys/wait.h>

#include <chrono>
#include <thread>

#include "calls.hpp"
#include "harness.hpp"
#include "program.hpp"

namespace sim2vr::openxr::test {
namespace {

using std::chrono::steady_clock;

/// A headless program that has begun its session, with `config`.
struct Gate : ::testing::Test {
  FakeHarness harness;
  Program program;

  void start(const nlohmann::json& config = nlohmann::json::object()) {
    harness.sendConfig(config);
    ASSERT_EQ(program.create({"XR_MND_headless", "XR_EXT_debug_utils"}), XR_SUCCESS);
    harness.send(MessageKind::accepted);
    ASSERT_EQ(program.createSession(), XR_SUCCESS);
    ASSERT_EQ(program.begin(), XR_SUCCESS);
    const auto hello = harness.receiveJson(MessageKind::hello);
    EXPECT_EQ(hello["application"], "program");
    EXPECT_EQ(hello["protocol"], 2);
    EXPECT_EQ(hello["pid"], ::getpid());
    const auto session = harness.receiveJson(MessageKind::session);
    EXPECT_EQ(session["graphics"], "headless");
    EXPECT_EQ(session["image_bytes"], 64);  // 2 eyes of 4 x 2 RGBA
  }
};

TEST_F(Gate, AFrameIsAStepAndItsEndTheAnswer) {
  start();
  harness.sendStep();
  XrFrameState state{};
  ASSERT_EQ(program.frame(&state), XR_SUCCESS);
  EXPECT_EQ(state.predictedDisplayTime, 1'010'000'000);
  EXPECT_EQ(state.predictedDisplayPeriod, 11'111'111);  // of 90 Hz
  EXPECT_EQ(state.shouldRender, XR_TRUE);
  FakeHarness::Head head;
  const auto answer = harness.receiveAnswer(&head);
  EXPECT_EQ(head.frames, 1U);
  EXPECT_FALSE(head.has_image);  // headless
  const std::vector<XrSessionState> expected{XR_SESSION_STATE_IDLE, XR_SESSION_STATE_READY,
                                             XR_SESSION_STATE_SYNCHRONIZED,
                                             XR_SESSION_STATE_VISIBLE, XR_SESSION_STATE_FOCUSED};
  EXPECT_EQ(program.states(), expected);
  ASSERT_EQ(answer["events"].size(), 5U);
  EXPECT_EQ(answer["events"][4]["state"], "FOCUSED");
}

TEST_F(Gate, SeveralFramesOfAStepAreAnsweredOnce) {
  start();
  harness.sendStep(3);
  for (int i = 0; i < 3; ++i) {
    XrFrameState state{};
    ASSERT_EQ(program.frame(&state), XR_SUCCESS);
    EXPECT_EQ(state.predictedDisplayTime, 1'010'000'000 + i * 10'000'000);
  }
  FakeHarness::Head head;
  harness.receiveAnswer(&head);
  EXPECT_EQ(head.frames, 3U);
}

TEST_F(Gate, QuitStopsTheSession) {
  start();
  harness.sendStep();
  ASSERT_EQ(program.frame(), XR_SUCCESS);
  program.states();
  harness.send(MessageKind::quit);
  XrFrameState state{};
  ASSERT_EQ(program.frame(&state), XR_SUCCESS);
  EXPECT_EQ(state.shouldRender, XR_FALSE);
  const XrTime before = state.predictedDisplayTime;
  ASSERT_EQ(program.frame(&state), XR_SUCCESS);
  EXPECT_GT(state.predictedDisplayTime, before);
  const std::vector<XrSessionState> expected{
      XR_SESSION_STATE_VISIBLE, XR_SESSION_STATE_SYNCHRONIZED, XR_SESSION_STATE_STOPPING};
  EXPECT_EQ(program.states(), expected);
  EXPECT_EQ(XR_CALL(program.instance, xrEndSession)(program.session), XR_SUCCESS);
  const std::vector<XrSessionState> last{XR_SESSION_STATE_IDLE, XR_SESSION_STATE_EXITING};
  EXPECT_EQ(program.states(), last);
  EXPECT_EQ(XR_CALL(program.instance, xrDestroySession)(program.session), XR_SUCCESS);
  harness.receiveAnswer();
  EXPECT_EQ(harness.receiveJson(MessageKind::ended)["call"], "xrDestroySession");
}

TEST_F(Gate, AHarnessThatIsGoneStopsAndThenLosesTheSession) {
  start();
  harness.sendStep();
  ASSERT_EQ(program.frame(), XR_SUCCESS);
  program.states();
  harness.close();
  ASSERT_EQ(program.frame(), XR_SUCCESS);
  EXPECT_EQ(program.states().back(), XR_SESSION_STATE_STOPPING);
  EXPECT_EQ(XR_CALL(program.instance, xrEndSession)(program.session), XR_SUCCESS);
  EXPECT_EQ(program.states(), std::vector{XR_SESSION_STATE_LOSS_PENDING});
  EXPECT_EQ(program.frame(), XR_ERROR_SESSION_LOST);
  EXPECT_EQ(XR_CALL(program.instance, xrDestroySession)(program.session), XR_SUCCESS);
}

TEST_F(Gate, AProgramThatIgnoresStoppingLosesItsSessionAfterASecond) {
  start();
  harness.close();
  int frames = 0;
  while (program.frame() == XR_SUCCESS && frames < 1000) ++frames;
  // A second at 90 Hz, however long the machine takes for it, and the frame that was on its way.
  EXPECT_NEAR(frames, 90, 1);
  EXPECT_EQ(program.frame(), XR_ERROR_SESSION_LOST);
}

TEST_F(Gate, ACallThatDoesNotComeIsNamed) {
  start({{"timeout_s", 0.1}});
  harness.sendStep();
  XrFrameState state{};
  state.type = XR_TYPE_FRAME_STATE;
  ASSERT_EQ(XR_CALL(program.instance, xrWaitFrame)(program.session, nullptr, &state), XR_SUCCESS);
  ASSERT_EQ(XR_CALL(program.instance, xrBeginFrame)(program.session, nullptr), XR_SUCCESS);
  const auto ended = harness.receiveJson(MessageKind::ended);
  EXPECT_EQ(ended["call"], "xrEndFrame");
  EXPECT_EQ(ended["reason"], "xrEndFrame did not follow xrBeginFrame within 0.1 s");
}

TEST_F(Gate, AProgramThatNeverWaitsIsNamed) {
  start({{"timeout_s", 0.1}});
  const auto ended = harness.receiveJson(MessageKind::ended);
  EXPECT_EQ(ended["reason"], "xrWaitFrame did not follow xrBeginSession within 0.1 s");
}

TEST_F(Gate, StrictLockstepRefusesToWaitAhead) {
  start({{"timeout_s", 0.2}});
  harness.sendStep();
  harness.sendStep();
  XrFrameState state{};
  state.type = XR_TYPE_FRAME_STATE;
  ASSERT_EQ(XR_CALL(program.instance, xrWaitFrame)(program.session, nullptr, &state), XR_SUCCESS);
  ASSERT_EQ(XR_CALL(program.instance, xrBeginFrame)(program.session, nullptr), XR_SUCCESS);
  XR_CALL(program.instance, xrWaitFrame)(program.session, nullptr, &state);
  const std::string reason = harness.receiveJson(MessageKind::ended)["reason"];
  EXPECT_NE(reason.find("before it ended the last: use gate: pipelined"), std::string::npos)
      << reason;
}

TEST_F(Gate, StrictLockstepWaitsForAnEndOnAnotherThread) {
  start();
  harness.sendStep();
  harness.sendStep();
  XrFrameState state{};
  state.type = XR_TYPE_FRAME_STATE;
  ASSERT_EQ(XR_CALL(program.instance, xrWaitFrame)(program.session, nullptr, &state), XR_SUCCESS);
  ASSERT_EQ(XR_CALL(program.instance, xrBeginFrame)(program.session, nullptr), XR_SUCCESS);
  const XrTime first = state.predictedDisplayTime;
  std::thread renderer([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    EXPECT_EQ(program.end(first), XR_SUCCESS);
  });
  EXPECT_EQ(XR_CALL(program.instance, xrWaitFrame)(program.session, nullptr, &state), XR_SUCCESS);
  EXPECT_EQ(state.predictedDisplayTime, first + 10'000'000);
  renderer.join();
  harness.receiveAnswer();
}

TEST_F(Gate, PipelinedLockstepAnswersWhenTheNextFrameIsWanted) {
  start({{"gate", "pipelined"}});
  harness.sendStep(2);
  harness.sendStep(1);
  XrFrameState state{};
  ASSERT_EQ(program.frame(&state), XR_SUCCESS);
  state.type = XR_TYPE_FRAME_STATE;
  ASSERT_EQ(XR_CALL(program.instance, xrWaitFrame)(program.session, nullptr, &state), XR_SUCCESS);
  ASSERT_EQ(XR_CALL(program.instance, xrBeginFrame)(program.session, nullptr), XR_SUCCESS);
  const XrTime second = state.predictedDisplayTime;
  // The second frame is not ended, and the third is there.
  ASSERT_EQ(XR_CALL(program.instance, xrWaitFrame)(program.session, nullptr, &state), XR_SUCCESS);
  EXPECT_EQ(state.predictedDisplayTime, second + 10'000'000);
  FakeHarness::Head head;
  harness.receiveAnswer(&head);
  EXPECT_EQ(head.frames, 2U);
  EXPECT_EQ(program.end(second), XR_SUCCESS);
}

TEST_F(Gate, LabelsAreEvents) {
  start();
  harness.sendStep();
  ASSERT_EQ(program.frame(), XR_SUCCESS);
  harness.receiveAnswer();
  const XrDebugUtilsLabelEXT label{XR_TYPE_DEBUG_UTILS_LABEL_EXT, nullptr, "score=3"};
  EXPECT_EQ(XR_CALL(program.instance, xrSessionInsertDebugUtilsLabelEXT)(program.session, &label),
            XR_SUCCESS);
  harness.sendStep();
  ASSERT_EQ(program.frame(), XR_SUCCESS);
  const auto answer = harness.receiveAnswer();
  EXPECT_EQ(answer["events"][0]["text"], "score=3");
  EXPECT_EQ(answer["events"][0]["kind"], "label");
}

TEST_F(Gate, AnotherSessionMayFollow) {
  start();
  EXPECT_EQ(program.createSession(), XR_ERROR_LIMIT_REACHED);
  EXPECT_EQ(XR_CALL(program.instance, xrDestroySession)(program.session), XR_SUCCESS);
  harness.receiveJson(MessageKind::ended);
  harness.send(MessageKind::accepted);
  ASSERT_EQ(program.createSession(), XR_SUCCESS);
  harness.receiveJson(MessageKind::session);
  ASSERT_EQ(program.begin(), XR_SUCCESS);
  harness.sendStep();
  EXPECT_EQ(program.frame(), XR_SUCCESS);
}

TEST_F(Gate, AnInstanceBesideALivingOneIsRefused) {
  start();
  Program other;
  EXPECT_EQ(other.create({"XR_MND_headless"}), XR_ERROR_LIMIT_REACHED);
}

TEST_F(Gate, TheHarnessMayRefuse) {
  harness.sendConfig();
  ASSERT_EQ(program.create({"XR_MND_headless"}), XR_SUCCESS);
  harness.send(MessageKind::error, R"({"error": "the user sees depth"})");
  EXPECT_EQ(program.createSession(), XR_ERROR_RUNTIME_FAILURE);
}

TEST_F(Gate, BadMessagesStopTheSession) {
  start();
  harness.send(MessageKind::step, "short");
  ASSERT_EQ(program.frame(), XR_SUCCESS);
  EXPECT_EQ(program.states().back(), XR_SESSION_STATE_STOPPING);
  EXPECT_EQ(harness.receiveJson(MessageKind::ended)["call"], "xrWaitFrame");
}

TEST_F(Gate, TimesGrowFromStepToStep) {
  start();
  harness.sendStep();
  ASSERT_EQ(program.frame(), XR_SUCCESS);
  harness.receiveAnswer();
  std::string body;
  wire::append<std::uint32_t>(body, 1);
  wire::append<std::int64_t>(body, harness.latest());
  for (int n = 0; n < 7; ++n) wire::append(body, n == 6 ? 1.0 : 0.0);
  body += std::string(2 + 8 * 40 + 1, '\0');
  harness.send(MessageKind::step, body);
  ASSERT_EQ(program.frame(), XR_SUCCESS);
  EXPECT_EQ(harness.receiveJson(MessageKind::ended)["reason"],
            "step.frames[0].time: got 1010000000 ns, expected above 1010000000, the previous "
            "frame's");
}

TEST_F(Gate, AForkedProcessIsRefusedAndLeavesTheSocketAlone) {
  start();
  const pid_t child = ::fork();
  if (child == 0) {
    PFN_xrVoidFunction poll = nullptr;
    const XrResult result = calls::xrGetInstanceProcAddr(program.instance, "xrPollEvent", &poll);
    ::_exit(result == XR_ERROR_RUNTIME_FAILURE ? 7 : 1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(WEXITSTATUS(status), 7);
  harness.sendStep();
  EXPECT_EQ(program.frame(), XR_SUCCESS);
}

TEST(Connecting, NeedsASocket) {
  ::setenv("SIM2VR_OPENXR_SOCKET", "many", 1);
  Program program;
  EXPECT_EQ(program.create({"XR_MND_headless"}), XR_ERROR_RUNTIME_UNAVAILABLE);
  ::setenv("SIM2VR_OPENXR_SOCKET", "77", 1);
  EXPECT_EQ(program.create({"XR_MND_headless"}), XR_ERROR_RUNTIME_UNAVAILABLE);
  ::unsetenv("SIM2VR_OPENXR_SOCKET");
}

TEST(Connecting, RefusesAConfigurationThatIsWrong) {
  FakeHarness harness;
  harness.sendConfig({{"eyes", 3}});
  Program program;
  EXPECT_EQ(program.create({"XR_MND_headless"}), XR_ERROR_RUNTIME_UNAVAILABLE);
}

TEST(Connecting, AHarnessThatIsSilentIsNamed) {
  FakeHarness harness;
  const int socket = std::atoi(std::getenv("SIM2VR_OPENXR_SOCKET"));
  const auto reason = [](auto work) -> std::string {
    try {
      work();
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "answered";
  };
  const std::string silent =
      "the harness gave no answer within 0.05 s, expected one to every hello and session; see "
      "where it hangs, and start the program again";
  EXPECT_EQ(reason([&] { Harness(socket, Hello{}, 0.05); }), silent);
  harness.sendConfig();
  Harness connected(socket, Hello{}, 0.05);
  EXPECT_EQ(reason([&] { connected.openSession("headless", false); }), silent);
  EXPECT_TRUE(connected.lost());
}

TEST(Connecting, ASessionWaitsForItsStepsWithoutALimit) {
  FakeHarness harness;
  const int socket = std::atoi(std::getenv("SIM2VR_OPENXR_SOCKET"));
  harness.sendConfig();
  harness.send(MessageKind::accepted);
  Harness connected(socket, Hello{}, 0.05);
  connected.openSession("headless", false);
  std::thread thinking([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    harness.sendStep();
  });
  EXPECT_EQ(connected.nextStep()->frames.size(), 1U);
  thinking.join();
}

TEST(RealTime, FramesKeepTheDisplaysPace) {
  Program program;
  ASSERT_EQ(program.create({"XR_MND_headless"}), XR_SUCCESS);
  ASSERT_EQ(program.createSession(), XR_SUCCESS);
  ASSERT_EQ(program.begin(), XR_SUCCESS);
  const auto begun = steady_clock::now();
  XrTime last = 0;
  for (int i = 0; i < 10; ++i) {
    XrFrameState state{};
    ASSERT_EQ(program.frame(&state), XR_SUCCESS);
    EXPECT_GT(state.predictedDisplayTime, last);
    last = state.predictedDisplayTime;
  }
  // Nine pauses of 1/90 s.
  EXPECT_GT(steady_clock::now() - begun, std::chrono::milliseconds(95));
}

}  // namespace
}  // namespace sim2vr::openxr::test

// SPDX-License-Identifier: Apache-2.0
// Calls from several threads at once (the preset tsan looks at them closely).
#include <atomic>
#include <thread>

#include "program.hpp"

namespace sim2vr::openxr::test {
namespace {

TEST(Threads, AnyCallBesideTheFrameLoop) {
  FakeHarness harness;
  harness.sendConfig();
  Program program;
  ASSERT_EQ(program.create({"XR_MND_headless"}), XR_SUCCESS);
  harness.send(MessageKind::accepted);
  ASSERT_EQ(program.createSession(), XR_SUCCESS);
  ASSERT_EQ(program.begin(), XR_SUCCESS);
  const XrSpace stage = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_STAGE);
  std::atomic<bool> done{false};
  const auto busy = [&] {
    while (!done) {
      const XrSpace space = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_VIEW);
      XrSpaceLocation location{XR_TYPE_SPACE_LOCATION, nullptr, 0, {}};
      EXPECT_EQ(XR_CALL(program.instance, xrLocateSpace)(space, stage, 1, &location), XR_SUCCESS);
      EXPECT_EQ(XR_CALL(program.instance, xrDestroySpace)(space), XR_SUCCESS);
      EXPECT_EQ(XR_CALL(program.instance, xrDestroySpace)(space), XR_ERROR_HANDLE_INVALID);
      program.path("/user/hand/left");
      program.states();
    }
  };
  std::thread one(busy);
  std::thread two(busy);
  for (int i = 0; i < 200; ++i) {
    harness.sendStep();
    ASSERT_EQ(program.frame(), XR_SUCCESS);
  }
  done = true;
  one.join();
  two.join();
}

TEST(Threads, TwoThatWaitTakeTurns) {
  FakeHarness harness;
  harness.sendConfig({{"gate", "pipelined"}});
  Program program;
  ASSERT_EQ(program.create({"XR_MND_headless"}), XR_SUCCESS);
  harness.send(MessageKind::accepted);
  ASSERT_EQ(program.createSession(), XR_SUCCESS);
  ASSERT_EQ(program.begin(), XR_SUCCESS);
  for (int i = 0; i < 100; ++i) harness.sendStep();
  std::atomic<XrTime> waited{0};
  std::atomic<int> frames{0};
  const auto wait = [&] {
    for (int i = 0; i < 50; ++i) {
      XrFrameState state{};
      state.type = XR_TYPE_FRAME_STATE;
      EXPECT_EQ(XR_CALL(program.instance, xrWaitFrame)(program.session, nullptr, &state),
                XR_SUCCESS);
      EXPECT_GT(state.predictedDisplayTime, waited.exchange(state.predictedDisplayTime));
      EXPECT_EQ(XR_CALL(program.instance, xrBeginFrame)(program.session, nullptr) >= 0, true);
      ++frames;
    }
  };
  std::thread one(wait);
  std::thread two(wait);
  one.join();
  two.join();
  EXPECT_EQ(frames, 100);
}

TEST(Threads, ASessionDestroyedUnderAWaitEndsIt) {
  FakeHarness harness;
  harness.sendConfig();
  Program program;
  ASSERT_EQ(program.create({"XR_MND_headless"}), XR_SUCCESS);
  harness.send(MessageKind::accepted);
  ASSERT_EQ(program.createSession(), XR_SUCCESS);
  ASSERT_EQ(program.begin(), XR_SUCCESS);
  std::thread waiting([&] {
    XrFrameState state{};
    state.type = XR_TYPE_FRAME_STATE;
    EXPECT_EQ(XR_CALL(program.instance, xrWaitFrame)(program.session, nullptr, &state),
              XR_ERROR_HANDLE_INVALID);
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(XR_CALL(program.instance, xrDestroySession)(program.session), XR_SUCCESS);
  harness.sendStep();
  waiting.join();
}

}  // namespace
}  // namespace sim2vr::openxr::test

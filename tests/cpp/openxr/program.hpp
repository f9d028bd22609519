// SPDX-License-Identifier: Apache-2.0
// A program in small, and the harness at the other end of its socket. Graphics are pixels in memory
// (XR_TEST_pixels), so that no device is needed.
#pragma once

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "api.hpp"
#include "harness.hpp"

namespace sim2vr::openxr::test {

/// Extension of the graphics in fake_graphics.cpp, and the binding that its sessions are made with.
inline constexpr const char* kPixels = "XR_TEST_pixels";
inline constexpr auto kPixelsBinding = static_cast<XrStructureType>(1999000001);
inline constexpr auto kPixelsImage = static_cast<XrStructureType>(1999000002);
inline constexpr std::int64_t kColorFormat = 1;
inline constexpr std::int64_t kDepthFormat = 2;
struct PixelsImage {
  XrStructureType type;
  void* next;
  std::uint8_t* rgba;  // of a depth image: floats
};

PFN_xrVoidFunction function(XrInstance instance, const char* name);
/// XR_CALL(instance, xrGetSystem)(...): as programs call it, through xrGetInstanceProcAddr.
#define XR_CALL(instance, name) \
  reinterpret_cast<PFN_##name>(::sim2vr::openxr::test::function(instance, #name))

/// The other end: everything the runtime will wait for is sent before.
class FakeHarness {
 public:
  FakeHarness();
  ~FakeHarness();
  FakeHarness(const FakeHarness&) = delete;
  FakeHarness& operator=(const FakeHarness&) = delete;

  void send(MessageKind kind, const std::string& body = {});
  void sendConfig(const nlohmann::json& changes = nlohmann::json::object());
  /// A step of frames 10 ms apart; the head is at (frame, 1.6, 0) in the app's frame.
  void sendStep(int frames = 1, bool image_wanted = true, double trigger = 0.0);
  Message receive() { return channel_->receive(); }
  /// The descriptor that comes with the next message, which stays to be received; -1: none.
  int file() const;
  nlohmann::json receiveJson(MessageKind kind);
  /// The JSON of an answer; `head`: its numbers before.
  struct Head {
    std::uint32_t frames = 0;
    bool has_image = false;
    bool has_depth = false;
  };
  nlohmann::json receiveAnswer(Head* head = nullptr);
  void close();
  XrTime latest() const { return time_; }

 private:
  int socket_ = -1;
  int program_ = -1;
  std::unique_ptr<Channel> channel_;
  XrTime time_ = 1'000'000'000;
  int frame_ = 0;
};

/// An instance, a system and what a program does with them.
struct Program {
  XrInstance instance = XR_NULL_HANDLE;
  XrSystemId system = 0;
  XrSession session = XR_NULL_HANDLE;

  Program() = default;
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  XrResult create(const std::vector<const char*>& extensions, XrVersion version = kVersion10);
  XrResult createSession(bool headless = true);
  /// READY is there: begins.
  XrResult begin();
  /// xrWaitFrame, xrBeginFrame, xrEndFrame.
  XrResult frame(XrFrameState* state = nullptr,
                 const std::vector<const XrCompositionLayerBaseHeader*>& layers = {});
  XrResult end(XrTime time, const std::vector<const XrCompositionLayerBaseHeader*>& layers = {});
  XrPath path(const char* text) const;
  XrSpace referenceSpace(XrReferenceSpaceType type) const;
  XrSwapchain swapchain(std::int64_t format, std::uint32_t width, std::uint32_t height,
                        std::uint32_t layers = 1) const;
  /// Acquires, waits, fills (RGBA or a float) and releases.
  void show(XrSwapchain swapchain, std::uint32_t rgba, float depth = 1.0F) const;
  /// States since the last call.
  std::vector<XrSessionState> states() const;
};

}  // namespace sim2vr::openxr::test

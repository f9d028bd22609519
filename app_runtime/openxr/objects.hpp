// SPDX-License-Identifier: Apache-2.0
// What the program holds handles of. Everything here is read and changed under the world's lock.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "api.hpp"
#include "graphics.hpp"
#include "harness.hpp"
#include "sim2vr/xr/tracking.hpp"
#include "world.hpp"

namespace sim2vr::openxr {

struct Session;

/// The one system: a headset with two controllers.
inline constexpr XrSystemId kSystem = 1;

struct ActionSet final : Object, xr::ActionSet {
  static constexpr HandleType kType = HandleType::action_set;
  std::string localized_name;
};

/// Bindings and states are those of the session that its set is attached to.
struct Action final : Object, xr::Action {
  static constexpr HandleType kType = HandleType::action;
  std::shared_ptr<ActionSet> owner;  // keeps `set`
  std::string localized_name;
  std::vector<XrPath> subactions;
};

struct SuggestedBinding {
  std::shared_ptr<Action> action;
  XrPath path = XR_NULL_PATH;
};

struct Messenger final : Object {
  static constexpr HandleType kType = HandleType::messenger;
  std::uint64_t severities = 0;
  std::uint64_t types = 0;
  PFN_xrDebugUtilsMessengerCallbackEXT callback = nullptr;
  void* user_data = nullptr;
};

struct Instance final : Object {
  static constexpr HandleType kType = HandleType::instance;
  XrVersion version = kVersion10;
  std::set<std::string, std::less<>> extensions;
  std::shared_ptr<Harness> harness;  // nullptr: real time
  Config config;
  std::unordered_map<std::string, XrPath> paths;
  std::vector<std::string> path_texts;  // path p is at p - 1
  std::deque<XrEventDataBuffer> events;
  std::set<std::string, std::less<>> requirements_asked;
  std::map<XrPath, std::vector<SuggestedBinding>> suggested;  // by interaction profile
  bool system_asked = false;

  bool enabled(std::string_view extension) const { return extensions.contains(extension); }
};

struct Space final : Object, xr::Space {
  static constexpr HandleType kType = HandleType::space;
  std::shared_ptr<Session> session;
  std::shared_ptr<Action> owner;  // keeps `action`
};

struct Swapchain final : Object {
  static constexpr HandleType kType = HandleType::swapchain;
  std::shared_ptr<Session> session;
  XrSwapchainCreateInfo info{};
  std::unique_ptr<SwapchainImages> images;
  std::deque<std::uint32_t> acquired;  // oldest first
  bool waited = false;                 // for the oldest
  std::uint32_t next = 0;
  std::optional<std::uint32_t> released;
  bool is_static = false;
};

/// xrWaitFrame, xrBeginFrame, xrEndFrame.
struct FrameLoop {
  bool waiting = false;  // a thread is inside xrWaitFrame
  bool waited = false;   // a frame was waited for and has not begun
  bool begun = false;
  std::uint64_t waited_frames = 0;
  std::uint64_t done_frames = 0;  // ended or discarded
};

/// The step that the harness gave.
struct StepProgress {
  std::deque<xr::Frame> frames;  // not yet handed out
  bool open = false;             // not yet answered
  bool image_wanted = false;
  std::uint32_t shown = 0;
  std::uint32_t layers = 0;
};

struct Session final : Object {
  static constexpr HandleType kType = HandleType::session;
  std::shared_ptr<Instance> instance;
  std::unique_ptr<Graphics> graphics;  // nullptr: headless
  std::string graphics_name = "headless";

  XrSessionState state = XR_SESSION_STATE_UNKNOWN;
  bool running = false;
  bool exiting = false;  // the program or the harness wants it to end
  bool lost = false;     // XR_ERROR_SESSION_LOST from now on
  bool harness_gone = false;
  std::uint32_t frames_after_stop = 0;
  bool destroyed = false;

  FrameLoop loop;
  StepProgress step;
  std::array<Picture, 2> pictures;  // of the latest frames, by frame number
  xr::Tracking tracking{32};
  std::int64_t monotonic_offset_ns = 0;  // XrTime - CLOCK_MONOTONIC

  std::vector<std::shared_ptr<ActionSet>> action_sets;
  bool attached = false;
  XrPath profile = XR_NULL_PATH;  // whose suggestions are bound
  XrPath announced_profile = XR_NULL_PATH;

  bool focused() const { return state == XR_SESSION_STATE_FOCUSED; }
  /// Time of the frame that was handed out last.
  XrTime now() const { return tracking.latest() == nullptr ? 1 : tracking.latest()->time; }
};

}  // namespace sim2vr::openxr

// SPDX-License-Identifier: Apache-2.0
// What the program holds handles of. Everything here is read and changed under the world's lock.
#pragma once

#include <array>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <new>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "api.hpp"
#include "graphics.hpp"
#include "harness.hpp"
#include "sim2vr/xr/tracking.hpp"

namespace sim2vr::openxr {

// What all calls share: one lock, the table of handles, and the way in which a call fails.

enum class HandleType : std::uint8_t {
  instance = 1,
  session,
  space,
  action_set,
  action,
  swapchain,
  messenger
};

/// Something that the program has a handle of.
struct Object {
  virtual ~Object() = default;
  std::uint64_t handle = 0;
  std::uint64_t parent = 0;
};

/// A handle is an index, a generation and a type: one that was destroyed never names its
/// successor. Entries with the same parent are a list, so that a program with many handles pays for
/// those that a call concerns.
class Handles {
 public:
  /// `parent`: a living handle, or 0 for an instance.
  std::uint64_t add(HandleType type, std::shared_ptr<Object> object, std::uint64_t parent);
  /// nullptr for a handle that is unknown, destroyed or of another type.
  std::shared_ptr<Object> find(HandleType type, std::uint64_t handle) const;
  /// With everything below it. Allocates nothing.
  void remove(std::uint64_t handle) noexcept;
  /// Living children of a type, in the order in which they were added. `parent`: 0 for instances.
  std::vector<std::shared_ptr<Object>> below(HandleType type, std::uint64_t parent) const;

 private:
  static constexpr std::uint32_t kNone = ~0U;
  struct List {
    std::uint32_t first = kNone;
    std::uint32_t last = kNone;
  };
  struct Entry {
    std::shared_ptr<Object> object;
    std::uint32_t generation = 0;
    HandleType type{};
    std::uint32_t next = kNone;  // with the same parent; of a free entry: the next free one
    std::uint32_t previous = kNone;
    List children;
  };
  const Entry* entry(std::uint64_t handle) const;
  /// nullptr: the parent is no living handle.
  const List* children(std::uint64_t parent) const;
  std::vector<Entry> entries_;
  List instances_;
  std::uint32_t free_ = kNone;
};

using Lock = std::unique_lock<std::mutex>;

struct World {
  std::mutex mutex;
  /// A frame began or ended, a session stopped, or the harness was lost.
  std::condition_variable changed;
  Handles handles;
};
/// Never destroyed: programs call from threads that outlive main().
World& world();

const char* resultName(XrResult result);
/// Writes "sim2vr OpenXR: CALL: RESULT: cause" to standard error, each line once, and hands it to
/// the program's debug messengers. Not under the lock. Throws nothing: without memory the line is
/// written as it is, and messengers hear nothing.
XrResult failed(const char* call, XrResult result, std::string_view cause);
/// One line to standard error, each once.
void report(const std::string& line);

/// The lock, unless this process was forked off the one that made the instance (Failure).
Lock enter();
/// Makes calls of forked processes fail, and closes `socket` in them (-1: none).
void watchForks(int socket);

template <class Work>
XrResult guarded(const char* call, Work&& work) {
  // Where no memory is left, the way out must not need any.
  try {
    Lock lock = enter();
    return work(lock);
  } catch (const Failure& failure) {
    return failed(call, failure.result(), failure.what());
  } catch (const std::bad_alloc&) {
    return failed(call, XR_ERROR_OUT_OF_MEMORY, "no memory is left");
  } catch (const std::exception& error) {
    return failed(call, XR_ERROR_RUNTIME_FAILURE, error.what());
  }
}

template <class Handle>
std::uint64_t number(Handle handle) {
  return reinterpret_cast<std::uint64_t>(handle);
}

/// The object of a handle. Throws Failure (XR_ERROR_HANDLE_INVALID).
template <class T, class Handle>
std::shared_ptr<T> get(Handle handle, const char* what) {
  auto object = std::static_pointer_cast<T>(world().handles.find(T::kType, number(handle)));
  if (!object) {
    throw Failure(XR_ERROR_HANDLE_INVALID,
                  std::string(what) + (number(handle) == 0 ? " is XR_NULL_HANDLE"
                                                           : " is no living handle of its type"));
  }
  return object;
}

template <class Handle, class T>
Handle add(const std::shared_ptr<T>& object, std::uint64_t parent) {
  return reinterpret_cast<Handle>(world().handles.add(T::kType, object, parent));
}

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

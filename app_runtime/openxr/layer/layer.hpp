// SPDX-License-Identifier: Apache-2.0
// What the recording layer shares: the next functions of the chain, and the recording of a session.
// It runs inside other people's programs while a person wears the headset: nothing here may end
// such a program, change what its calls return, or keep its frames waiting.
#pragma once

#include <openxr/openxr.h>

#include <array>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "sim2vr/xr/device.hpp"

namespace sim2vr::openxr::layer {

/// One line to standard error, without allocating; `detail` may be empty.
void say(const char* what, const char* detail = "");

/// Every function that the layer calls: those that it intercepts, and those that it reads with.
#define SIM2VR_LAYER_FUNCTIONS(X)        \
  X(xrDestroyInstance)                   \
  X(xrCreateSession)                     \
  X(xrDestroySession)                    \
  X(xrSuggestInteractionProfileBindings) \
  X(xrAttachSessionActionSets)           \
  X(xrSyncActions)                       \
  X(xrWaitFrame)                         \
  X(xrEndFrame)                          \
  X(xrApplyHapticFeedback)               \
  X(xrStringToPath)                      \
  X(xrPathToString)                      \
  X(xrCreateActionSet)                   \
  X(xrCreateAction)                      \
  X(xrCreateActionSpace)                 \
  X(xrCreateReferenceSpace)              \
  X(xrLocateSpace)                       \
  X(xrGetActionStateBoolean)             \
  X(xrGetActionStateFloat)               \
  X(xrGetActionStateVector2f)            \
  X(xrEnumerateBoundSourcesForAction)

/// The functions below us in the chain of one instance.
struct Next {
  XrInstance instance = XR_NULL_HANDLE;
  PFN_xrGetInstanceProcAddr get = nullptr;
#define SIM2VR_MEMBER(name) PFN_##name name = nullptr;
  SIM2VR_LAYER_FUNCTIONS(SIM2VR_MEMBER)
#undef SIM2VR_MEMBER
  /// False: one is missing, so that none may be called.
  bool fill();
  XrPath path(const std::string& text) const;
};

/// Actions of our own beside the program's, which read both controllers.
class OwnActions {
 public:
  /// Makes the set and its actions; priority 0, so that a program's set with a higher one keeps the
  /// inputs that it binds.
  bool create(const Next& next);
  XrActionSet set() const { return set_; }
  /// The program's suggestions for a profile, and ours for what the profile has.
  std::vector<XrActionSuggestedBinding> withOurs(
      const Next& next, const XrInteractionProfileSuggestedBinding& suggested) const;
  bool attached() const { return attached_; }
  /// Spaces of grips and aims, once the set is attached.
  void attach(const Next& next, XrSession session);
  /// The session is over; the set stays for the instance's next one.
  void detach() { attached_ = false; }
  /// As of the latest xrSyncActions, with poses in `base`.
  xr::ControllerState read(const Next& next, XrSession session, xr::Hand hand, XrSpace base,
                           XrTime time) const;

 private:
  enum Kind { grip, aim, trigger, squeeze, stick, stick_click, lower, upper, menu, kinds };
  XrAction make(const Next& next, const char* name, XrActionType type) const;

  XrActionSet set_ = XR_NULL_HANDLE;
  std::array<XrAction, kinds> actions_{};
  std::array<XrPath, 2> hands_{};
  std::array<std::array<XrSpace, 2>, 2> spaces_{};  // grip, aim; by hand
  bool attached_ = false;
};

/// What a recording lacks.
struct Lost {
  std::uint64_t frames = 0;
  std::uint64_t vibrations = 0;
};

struct Vibration {
  xr::Hand hand;
  float amplitude;
  float frequency_hz;
  XrDuration duration_ns;  // or XR_MIN_HAPTIC_DURATION
};
struct Vibrations {
  std::array<Vibration, 16> each;
  std::size_t count = 0;
};

/// A frame that ended. What the program reads until it waits for the next frame, it reads of this
/// one: only then its inputs are known.
struct EndedFrame {
  XrTime time = 0;  // 0: none
  XrPosef head = xr::kIdentityPose;
  std::array<xr::ControllerState, 2> hands;
  Vibrations vibrations;  // since the frame before ended
  Lost lost;              // before this one
};

/// The file of a session, one JSON object a line (docs/reference/sessions.md). A thread of its own
/// makes and writes the lines; the program's threads only copy frames into a queue of fixed size.
class Recording {
 public:
  /// Frames that wait to be written; of 90 Hz, more than 5 s.
  static constexpr std::size_t kWaiting = 512;

  /// `file`: a descriptor, which the recording closes.
  Recording(int file, const std::string& application);
  /// Writes what waits.
  ~Recording();
  Recording(const Recording&) = delete;
  Recording& operator=(const Recording&) = delete;

  /// Neither allocates nor waits for the file.
  void add(const EndedFrame& frame);
  void lose(const Lost& lost);

 private:
  void work();
  void write(const EndedFrame& frame);
  void writeLost(XrTime time);
  /// False: it could not be written, nor can anything after it.
  bool write(std::string_view text);

  int file_;
  int error_ = 0;  // of the first write that failed
  XrTime first_ = 0;
  XrTime latest_ = 0;  // since the first frame
  Lost unwritten_;     // not yet told in the file
  Lost all_;

  std::mutex mutex_;
  std::condition_variable more_;
  std::vector<EndedFrame> waiting_;  // a ring
  std::size_t oldest_ = 0;
  std::size_t count_ = 0;
  Lost lost_;  // since the latest frame that found room
  bool closing_ = false;
  std::thread writer_;
};

}  // namespace sim2vr::openxr::layer

// What the recording layer shares: the next functions of the chain, and the recording of a session.
#pragma once

#include <openxr/openxr.h>

#include <array>
#include <cstdio>
#include <string>
#include <vector>

#include "sim2vr/xr/device.hpp"

namespace sim2vr::openxr::layer {

/// The functions below us.
class Next {
 public:
  Next() = default;
  Next(XrInstance instance, PFN_xrGetInstanceProcAddr entry) : instance_(instance), get_(entry) {}
  XrInstance instance() const { return instance_; }
  PFN_xrGetInstanceProcAddr get() const { return get_; }
  /// nullptr: there is none.
  template <class F>
  F function(const char* name) const {
    PFN_xrVoidFunction found = nullptr;
    get_(instance_, name, &found);
    return reinterpret_cast<F>(found);
  }
  XrPath path(const std::string& text) const;

 private:
  XrInstance instance_ = XR_NULL_HANDLE;
  PFN_xrGetInstanceProcAddr get_ = nullptr;
};
#define SIM2VR_NEXT(next, name) ((next).function<PFN_##name>(#name))

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

/// The file of a session, one JSON object a line (docs/reference/sessions.md).
class Recording {
 public:
  /// `path`: with %p for the process's number. Writes the header.
  Recording(std::string path, const std::string& application);
  ~Recording();
  Recording(const Recording&) = delete;
  Recording& operator=(const Recording&) = delete;
  bool isOpen() const { return file_ != nullptr; }

  void frame(XrTime time, const XrPosef& head, const std::array<xr::ControllerState, 2>& hands);
  /// duration: ns, or XR_MIN_HAPTIC_DURATION.
  void haptic(const char* hand, const XrHapticVibration& vibration);

 private:
  void line(const std::string& text);

  std::FILE* file_ = nullptr;
  XrTime first_ = 0;
  XrTime latest_ = 0;  // since the first frame
};

}  // namespace sim2vr::openxr::layer

// SPDX-License-Identifier: Apache-2.0
// Where devices and spaces were, at the times of the latest frames and between them.
#pragma once

#include <openxr/openxr.h>

#include <optional>
#include <vector>

#include "sim2vr/xr/action.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::xr {

/// LOCAL_FLOOR, which headers of 1.0 lack.
inline constexpr auto kLocalFloor = static_cast<XrReferenceSpaceType>(1000426000);

/// The devices at the time at which a frame is displayed.
struct Frame {
  XrTime time = 0;
  DeviceState devices;

  void fields(Archive& archive);
};

/// A place that can be located: a reference space or an action space, with a fixed offset. STAGE
/// has its origin on the floor, VIEW is the head. LOCAL is where the head was in the first frame,
/// turned by its yaw alone; LOCAL_FLOOR is the floor below it.
struct Space {
  XrReferenceSpaceType reference = XR_REFERENCE_SPACE_TYPE_STAGE;
  const Action* action = nullptr;  // not null: an action space
  std::size_t hand = kBothHands;   // index into Action::states
  XrPosef offset = kIdentityPose;  // pose of this space in its reference or action space
};

/// A pose in STAGE and how it moves there.
struct Motion {
  XrPosef pose = kIdentityPose;
  XrVector3f linear{0.0F, 0.0F, 0.0F};   // m/s
  XrVector3f angular{0.0F, 0.0F, 0.0F};  // rad/s
};

class Tracking {
 public:
  /// Keeps so many of the latest frames.
  explicit Tracking(std::size_t frames) : maximum_(frames) {}

  /// Notes the devices of a frame, whose time is after the one's before; the first one places
  /// LOCAL.
  void track(const Frame& frame);
  /// The latest frame; null before the first.
  const Frame* latest() const { return frames_.empty() ? nullptr : &frames_.back(); }

  /// Nothing: not tracked, or an action space whose action is inactive. Before the first frame the
  /// head is where a person of 1.75 m has it.
  std::optional<Motion> locate(const Space& space, XrTime time) const;
  /// `space` as seen from `base`.
  std::optional<Motion> locate(const Space& space, const Space& base, XrTime time) const;

  void fields(Archive& archive);

 private:
  struct Followed;
  std::optional<Motion> follow(const Followed& what, XrTime time) const;
  std::optional<Motion> locateAction(const Space& space, XrTime time) const;

  std::size_t maximum_;
  std::vector<Frame> frames_;  // newest last
  std::optional<XrPosef> stage_T_local_;
};

/// The left (0) or the right (1) eye in VIEW.
inline Space eyeSpace(std::size_t eye, double ipd_m) {
  const auto half = static_cast<float>(0.5 * ipd_m);
  return {.reference = XR_REFERENCE_SPACE_TYPE_VIEW,
          .offset = {{0.0F, 0.0F, 0.0F, 1.0F}, {eye == 0 ? -half : half, 0.0F, 0.0F}}};
}
/// Half angles of an eye, symmetric (rad). `aspect`: width / height.
XrFovf eyeFov(double vertical_fov_deg, double aspect);

}  // namespace sim2vr::xr

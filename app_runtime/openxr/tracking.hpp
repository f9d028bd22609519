// Where devices and spaces were, at the times of the latest frames and between them.
#pragma once

#include <optional>

#include "objects.hpp"

namespace sim2vr::openxr {

/// A pose in STAGE and how it moves there.
struct Motion {
  XrPosef pose = xr::kIdentityPose;
  XrVector3f linear{0.0F, 0.0F, 0.0F};   // m/s
  XrVector3f angular{0.0F, 0.0F, 0.0F};  // rad/s
};

/// Notes the devices of a frame; the first one places LOCAL.
void track(Session& session, const Frame& frame);

/// Nothing: not tracked, or an action space whose action is inactive. Before the first frame the
/// head is where a person of 1.75 m has it.
std::optional<Motion> locate(const Session& session, const Space& space, XrTime time);
/// `motion` as seen from `base`.
Motion relative(const Motion& base, const Motion& motion);
/// Eye 0 (left) or 1 in STAGE.
XrPosef eyePose(const Session& session, std::uint32_t eye, XrTime time);

}  // namespace sim2vr::openxr

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/xr/tracking.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/math.hpp"
#include "xr_archive.hpp"

namespace sim2vr::xr {
namespace {

constexpr XrPosef kStandingHead{{0.0F, 0.0F, 0.0F, 1.0F}, {0.0F, 1.6F, 0.0F}};

Vec3 vector(const XrVector3f& v) { return {v.x, v.y, v.z}; }
XrVector3f rounded(const Vec3& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}
Quat rotation(const XrQuaternionf& q) { return Quat(q.w, q.x, q.y, q.z).normalized(); }

/// Turns -z into the head's viewing direction, as seen from above.
XrQuaternionf yawOf(const XrQuaternionf& head) {
  const Vec3 back = rotation(head) * Vec3::UnitZ();
  const double half = 0.5 * std::atan2(back.x(), back.z());
  return {0.0F, static_cast<float>(std::sin(half)), 0.0F, static_cast<float>(std::cos(half))};
}

XrPosef between(const XrPosef& a, const XrPosef& b, double share) {
  if (share <= 0.0) return a;
  if (share >= 1.0) return b;
  const Quat turned = rotation(a.orientation).slerp(share, rotation(b.orientation));
  return {{static_cast<float>(turned.x()), static_cast<float>(turned.y()),
           static_cast<float>(turned.z()), static_cast<float>(turned.w())},
          rounded(vector(a.position) * (1.0 - share) + vector(b.position) * share)};
}

Motion moving(const XrPosef& a, const XrPosef& b, double share, double seconds) {
  const Eigen::AngleAxisd turn(rotation(b.orientation) * rotation(a.orientation).conjugate());
  const double angle = turn.angle() > M_PI ? turn.angle() - 2.0 * M_PI : turn.angle();
  return {between(a, b, share), rounded((vector(b.position) - vector(a.position)) / seconds),
          rounded(turn.axis() * (angle / seconds))};
}

/// `offset` in a moving frame.
Motion shifted(const Motion& motion, const XrPosef& offset) {
  const Vec3 arm = rotation(motion.pose.orientation) * vector(offset.position);
  return {compose(motion.pose, offset),
          rounded(vector(motion.linear) + vector(motion.angular).cross(arm)), motion.angular};
}

}  // namespace

void Frame::fields(Archive& archive) {
  archive.field("time", time);
  archive.field("devices", devices);
}

/// What a space follows: the head, or a hand's grip or aim.
struct Tracking::Followed {
  std::optional<Hand> hand;
  bool aim = false;

  bool tracked(const Frame& frame) const { return !hand || frame.devices.hand(*hand).active; }
  const XrPosef& pose(const Frame& frame) const {
    if (!hand) return frame.devices.head;
    const ControllerState& controller = frame.devices.hand(*hand);
    return aim ? controller.aim : controller.grip;
  }
};

void Tracking::track(const Frame& frame) {
  if (frames_.size() == maximum_) frames_.erase(frames_.begin());
  frames_.push_back(frame);
  if (stage_T_local_) return;
  stage_T_local_ = {yawOf(frame.devices.head.orientation), frame.devices.head.position};
}

/// Between the two frames that enclose the time, or at the nearest one.
std::optional<Motion> Tracking::follow(const Followed& what, XrTime time) const {
  if (frames_.empty()) {
    if (what.hand) return std::nullopt;
    return Motion{.pose = kStandingHead};
  }
  auto later = std::lower_bound(frames_.begin(), frames_.end(), time,
                                [](const Frame& frame, XrTime t) { return frame.time < t; });
  if (later == frames_.end()) --later;
  if (!what.tracked(*later)) return std::nullopt;
  const XrPosef& pose = what.pose(*later);
  if (later == frames_.begin() || !what.tracked(*std::prev(later))) return Motion{.pose = pose};
  const Frame& earlier = *std::prev(later);
  const auto span = static_cast<double>(later->time - earlier.time);
  const double share = static_cast<double>(time - earlier.time) / span;
  return moving(what.pose(earlier), pose, share, span * 1e-9);
}

std::optional<Motion> Tracking::locateAction(const Space& space, XrTime time) const {
  const Action& action = *space.action;
  if (!action.states[space.hand].active) return std::nullopt;
  for (const Component* component : action.bindings) {
    const Hand hand = *component->hand;
    if (space.hand != kBothHands && space.hand != static_cast<std::size_t>(hand)) continue;
    if (!action.state(hand).active) continue;
    return follow({hand, component->input == Input::aim_pose}, time);
  }
  return std::nullopt;
}

std::optional<Motion> Tracking::locate(const Space& space, XrTime time) const {
  std::optional<Motion> origin;
  if (space.action != nullptr) {
    origin = locateAction(space, time);
  } else if (space.reference == XR_REFERENCE_SPACE_TYPE_VIEW) {
    origin = follow({}, time);
  } else {
    origin.emplace();
    if (space.reference != XR_REFERENCE_SPACE_TYPE_STAGE) {
      origin->pose = stage_T_local_.value_or(kStandingHead);
    }
    if (space.reference == kLocalFloor) origin->pose.position.y = 0.0F;
  }
  if (origin) return shifted(*origin, space.offset);
  return std::nullopt;
}

std::optional<Motion> Tracking::locate(const Space& space, const Space& base, XrTime time) const {
  const auto moved = locate(space, time);
  const auto from = locate(base, time);
  if (!moved || !from) return std::nullopt;
  const Quat base_T_stage = rotation(from->pose.orientation).conjugate();
  const Vec3 arm = vector(moved->pose.position) - vector(from->pose.position);
  return Motion{compose(inverse(from->pose), moved->pose),
                rounded(base_T_stage * (vector(moved->linear) - vector(from->linear) -
                                        vector(from->angular).cross(arm))),
                rounded(base_T_stage * (vector(moved->angular) - vector(from->angular)))};
}

void Tracking::fields(Archive& archive) {
  archive.field("frames", frames_);
  if (frames_.size() > maximum_) {
    throw EngineError("saved state: field 'frames': got " + std::to_string(frames_.size()) +
                      ", expected up to " + std::to_string(maximum_));
  }
  XrPosef local = stage_T_local_.value_or(kStandingHead);
  poseField(archive, "stage_T_local", local);
  if (!frames_.empty()) stage_T_local_ = local;
}

XrFovf eyeFov(double vertical_fov_deg, double aspect) {
  const double half_height = std::tan(0.5 * vertical_fov_deg * std::numbers::pi / 180.0);
  const auto up = static_cast<float>(std::atan(half_height));
  const auto right = static_cast<float>(std::atan(half_height * aspect));
  return {-right, right, up, -up};
}

}  // namespace sim2vr::xr

#include "tracking.hpp"

#include <algorithm>
#include <cmath>

#include "profiles.hpp"
#include "sim2vr/core/math.hpp"

namespace sim2vr::openxr {
namespace {

constexpr std::size_t kHistoryFrames = 32;
constexpr float kStandingEyes_m = 1.6F;

using Vector = Eigen::Vector3d;
using Rotation = Eigen::Quaterniond;

Vector vector(const XrVector3f& v) { return {v.x, v.y, v.z}; }
XrVector3f toXr(const Vector& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}
Rotation rotation(const XrQuaternionf& q) { return Rotation(q.w, q.x, q.y, q.z).normalized(); }
XrQuaternionf toXr(const Rotation& q) {
  return {static_cast<float>(q.x()), static_cast<float>(q.y()), static_cast<float>(q.z()),
          static_cast<float>(q.w())};
}

/// Turns -z into the head's viewing direction, as seen from above.
XrQuaternionf yawOf(const XrQuaternionf& head) {
  const Vector back = rotation(head) * Vector::UnitZ();
  const double half = 0.5 * std::atan2(back.x(), back.z());
  return {0.0F, static_cast<float>(std::sin(half)), 0.0F, static_cast<float>(std::cos(half))};
}

XrPosef defaultHead() { return {{0.0F, 0.0F, 0.0F, 1.0F}, {0.0F, kStandingEyes_m, 0.0F}}; }

XrPosef between(const XrPosef& a, const XrPosef& b, double share) {
  if (share <= 0.0) return a;
  if (share >= 1.0) return b;
  const Vector position = vector(a.position) * (1.0 - share) + vector(b.position) * share;
  return {toXr(rotation(a.orientation).slerp(share, rotation(b.orientation))), toXr(position)};
}

Motion moving(const XrPosef& a, const XrPosef& b, double share, double seconds) {
  Motion motion{between(a, b, share)};
  motion.linear = toXr((vector(b.position) - vector(a.position)) / seconds);
  const Eigen::AngleAxisd turn(rotation(b.orientation) * rotation(a.orientation).conjugate());
  const double angle = turn.angle() > M_PI ? turn.angle() - 2.0 * M_PI : turn.angle();
  motion.angular = toXr(turn.axis() * (angle / seconds));
  return motion;
}

/// What a space follows in the devices' state.
using PoseOf = XrPosef (*)(const xr::DeviceState&, int hand);

XrPosef headOf(const xr::DeviceState& state, int) { return state.head; }
XrPosef gripOf(const xr::DeviceState& state, int hand) {
  return state.hands[static_cast<std::size_t>(hand)].grip;
}
XrPosef aimOf(const xr::DeviceState& state, int hand) {
  return state.hands[static_cast<std::size_t>(hand)].aim;
}

bool tracked(const Frame& frame, int hand) {
  return hand < 0 || frame.devices.hands[static_cast<std::size_t>(hand)].active;
}

/// The device's pose at a time: between two frames that enclose it, or at the nearest one. hand -1:
/// the head.
std::optional<Motion> follow(const Session& session, PoseOf pose, int hand, XrTime time) {
  const auto& history = session.history;
  if (history.empty()) {
    if (hand >= 0) return std::nullopt;
    return Motion{.pose = defaultHead()};
  }
  auto later = std::lower_bound(history.begin(), history.end(), time,
                                [](const Frame& frame, XrTime t) { return frame.time < t; });
  if (later == history.end()) --later;
  if (!tracked(*later, hand)) return std::nullopt;
  const XrPosef b = pose(later->devices, hand);
  if (later == history.begin()) return Motion{b};
  const auto earlier = std::prev(later);
  if (!tracked(*earlier, hand)) return Motion{b};
  const auto span = static_cast<double>(later->time - earlier->time);
  const double share = static_cast<double>(time - earlier->time) / span;
  return moving(pose(earlier->devices, hand), b, share, span * 1e-9);
}

/// `offset` in a moving frame.
Motion shifted(const Motion& motion, const XrPosef& offset) {
  Motion result = motion;
  result.pose = xr::compose(motion.pose, offset);
  const Vector arm = rotation(motion.pose.orientation) * vector(offset.position);
  result.linear = toXr(vector(motion.linear) + vector(motion.angular).cross(arm));
  return result;
}

std::optional<Motion> locateAction(const Session& session, const Space& space, XrTime time) {
  const Action& action = *space.action;
  if (!session.synced || !action.values[static_cast<std::size_t>(space.hand)].active) {
    return std::nullopt;
  }
  for (const Component* component : action.bound) {
    if (space.hand != 2 && component->hand != space.hand) continue;
    if (!action.values[static_cast<std::size_t>(component->hand)].active) continue;
    return follow(session, component->input == Input::aim_pose ? &aimOf : &gripOf, component->hand,
                  time);
  }
  return std::nullopt;
}

XrPosef localInStage(const Session& session) {
  return session.stage_T_local.value_or(defaultHead());
}

}  // namespace

void track(Session& session, const Frame& frame) {
  session.history.push_back(frame);
  if (session.history.size() > kHistoryFrames) session.history.pop_front();
  if (!session.stage_T_local) {
    const XrPosef& head = frame.devices.head;
    session.stage_T_local = {yawOf(head.orientation), head.position};
  }
}

std::optional<Motion> locate(const Session& session, const Space& space, XrTime time) {
  std::optional<Motion> origin;
  if (space.action) {
    origin = locateAction(session, space, time);
  } else if (space.reference == XR_REFERENCE_SPACE_TYPE_VIEW) {
    origin = follow(session, &headOf, -1, time);
  } else if (space.reference == XR_REFERENCE_SPACE_TYPE_STAGE) {
    origin = Motion{};
  } else {
    origin = Motion{localInStage(session)};
    if (space.reference == kLocalFloor) origin->pose.position.y = 0.0F;
  }
  if (origin) return shifted(*origin, space.offset);
  return std::nullopt;
}

Motion relative(const Motion& base, const Motion& motion) {
  const Rotation base_T_stage = rotation(base.pose.orientation).conjugate();
  const Vector arm = vector(motion.pose.position) - vector(base.pose.position);
  Motion result;
  result.pose = xr::compose(xr::inverse(base.pose), motion.pose);
  result.linear = toXr(base_T_stage * (vector(motion.linear) - vector(base.linear) -
                                       vector(base.angular).cross(arm)));
  result.angular = toXr(base_T_stage * (vector(motion.angular) - vector(base.angular)));
  return result;
}

XrPosef eyePose(const Session& session, std::uint32_t eye, XrTime time) {
  const Motion head = *follow(session, &headOf, -1, time);
  const auto half = static_cast<float>(0.5 * session.instance->config.ipd_m);
  return xr::compose(head.pose, {{0.0F, 0.0F, 0.0F, 1.0F}, {eye == 0 ? -half : half, 0.0F, 0.0F}});
}

}  // namespace sim2vr::openxr

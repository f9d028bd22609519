// Session: spaces and views.
#include <cmath>
#include <numbers>

#include "input_paths.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::xr {
namespace {

constexpr XrSpaceLocationFlags kTracked =
    XR_SPACE_LOCATION_ORIENTATION_VALID_BIT | XR_SPACE_LOCATION_POSITION_VALID_BIT |
    XR_SPACE_LOCATION_ORIENTATION_TRACKED_BIT | XR_SPACE_LOCATION_POSITION_TRACKED_BIT;

// Rotation about y that turns -z into the head's viewing direction, as seen from above.
XrQuaternionf yawOf(const XrQuaternionf& q) {
  const double x = q.x;
  const double y = q.y;
  const double z = q.z;
  const double w = q.w;
  // Third column of the rotation matrix: the head's backward axis.
  const double back_x = 2.0 * (x * z + w * y);
  const double back_z = 1.0 - 2.0 * (x * x + y * y);
  const double half_yaw = 0.5 * std::atan2(back_x, back_z);
  return {0.0F, static_cast<float>(std::sin(half_yaw)), 0.0F,
          static_cast<float>(std::cos(half_yaw))};
}

}  // namespace

Space Session::referenceSpace(XrReferenceSpaceType type, const XrPosef& offset) const {
  if (type != XR_REFERENCE_SPACE_TYPE_VIEW && type != XR_REFERENCE_SPACE_TYPE_LOCAL &&
      type != XR_REFERENCE_SPACE_TYPE_STAGE) {
    throw InvalidArgument("reference space type", std::to_string(type), "VIEW, LOCAL or STAGE");
  }
  return {type, nullptr, Hand::left, offset};
}

Space Session::actionSpace(const Action& action, Hand hand, const XrPosef& offset) const {
  const bool fits = action.type() == XR_ACTION_TYPE_POSE_INPUT && action.hasHand(hand);
  if (!fits) {
    throw InvalidArgument("action '" + action.name() + "'", "a request for an action space",
                          "a pose action that was created with this hand");
  }
  return {XR_REFERENCE_SPACE_TYPE_STAGE, &action, hand, offset};
}

void Session::recenter() {
  const XrPosef& head = sampleFrame().head;
  stage_T_local_ = {yawOf(head.orientation), {0.0F, head.position.y, 0.0F}};
}

std::optional<XrPosef> Session::locateInStage(const Space& space, const DeviceState& state) const {
  if (space.action != nullptr) {
    if (!space.action->perHand(space.hand).active) return std::nullopt;
    for (const InputPath* input : space.action->bindings_) {
      if (input->hand != space.hand) continue;
      const ControllerState& controller = state.hand(space.hand);
      if (!controller.active) return std::nullopt;
      return compose(input->kind == InputKind::aim_pose ? controller.aim : controller.grip,
                     space.offset);
    }
    return std::nullopt;
  }
  if (space.reference == XR_REFERENCE_SPACE_TYPE_VIEW) return compose(state.head, space.offset);
  if (space.reference == XR_REFERENCE_SPACE_TYPE_LOCAL) {
    return compose(stage_T_local_, space.offset);
  }
  return space.offset;
}

XrSpaceLocation Session::locateSpace(const Space& space, const Space& base, XrTime time) {
  const DeviceState state = sampleAt(time);
  const std::optional<XrPosef> stage_T_space = locateInStage(space, state);
  const std::optional<XrPosef> stage_T_base = locateInStage(base, state);
  if (!stage_T_space || !stage_T_base) {
    return {XR_TYPE_SPACE_LOCATION, nullptr, 0, kIdentityPose};
  }
  return {XR_TYPE_SPACE_LOCATION, nullptr, kTracked,
          compose(inverse(*stage_T_base), *stage_T_space)};
}

std::vector<XrView> Session::locateViews(XrTime time, const Space& base) {
  const double half_height = std::tan(0.5 * settings_.vertical_fov_deg * std::numbers::pi / 180.0);
  const auto up = static_cast<float>(std::atan(half_height));
  const auto right = static_cast<float>(std::atan(half_height * settings_.aspect));
  std::vector<XrView> views;
  for (const float side : {-0.5F, 0.5F}) {
    const XrPosef head_T_eye{{0.0F, 0.0F, 0.0F, 1.0F}, {side * settings_.ipd_m, 0.0F, 0.0F}};
    const Space eye = referenceSpace(XR_REFERENCE_SPACE_TYPE_VIEW, head_T_eye);
    views.push_back(
        {XR_TYPE_VIEW, nullptr, locateSpace(eye, base, time).pose, {-right, right, up, -up}});
  }
  return views;
}

}  // namespace sim2vr::xr

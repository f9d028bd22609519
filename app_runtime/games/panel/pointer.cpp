// SPDX-License-Identifier: Apache-2.0
#include "panel/pointer.hpp"

#include <cmath>
#include <vector>

#include "sim2vr/xr/frames.hpp"

namespace sim2vr::games::panel {
namespace {

// A fingertip farther from the plane points at nothing.
constexpr double kNear_m = 0.15;
// How steeply a ray has to meet the plane.
constexpr double kLeastForward = 0.05;

// At half strength, at the frequency that the controller likes best.
constexpr XrHapticVibration kPulse{XR_TYPE_HAPTIC_VIBRATION, nullptr, 20'000'000,
                                   XR_FREQUENCY_UNSPECIFIED, 0.5F};

}  // namespace

Controls Controls::make(xr::Session& session) {
  xr::ActionSet& set = session.createActionSet("panel");
  const auto bound = [&](const char* name, XrActionType type, const char* path) {
    xr::Action& action = session.createAction(set, name, type);
    session.suggestBinding(action, std::string("/user/hand/left/") + path);
    session.suggestBinding(action, std::string("/user/hand/right/") + path);
    return &action;
  };
  return {bound("aim", XR_ACTION_TYPE_POSE_INPUT, "input/aim/pose"),
          bound("trigger", XR_ACTION_TYPE_BOOLEAN_INPUT, "input/trigger/value"),
          bound("squeeze", XR_ACTION_TYPE_BOOLEAN_INPUT, "input/squeeze/value"),
          bound("scroll", XR_ACTION_TYPE_VECTOR2F_INPUT, "input/thumbstick"),
          bound("vibrate", XR_ACTION_TYPE_VIBRATION_OUTPUT, "output/haptic")};
}

void PointerState::fields(Archive& archive) {
  archive.field("active", active);
  archive.field("on_plane", on_plane);
  archive.field("place_m", place_m);
  archive.field("origin_m", origin_m);
  archive.field("forward", forward);
  archive.field("held", held);
  archive.field("pressed", pressed);
  archive.field("released", released);
  archive.field("roll_rad", roll_rad, kQuantities);
  archive.field("scroll", scroll, kQuantities);
}

void Pointer::update(const Vec3& center_m) {
  const bool was_held = state_.held;
  state_ = PointerState();
  state_.active = controller_->activeInHierarchy();
  if (state_.active) {
    if (select_ == Select::ray) {
      updateRay(center_m);
    } else {
      updateTouch(center_m);
    }
    const Quat& turned = controller_->transform().rotation();
    const Vec3 right = turned * Vec3::UnitX();
    state_.roll_rad = std::atan2(-right.y(), (turned * Vec3::UnitY()).y());
    state_.scroll = session_->actionState(*controls_.scroll, hand_).value.y;
  } else {
    in_front_ = false;
  }
  state_.pressed = state_.held && !was_held;
  state_.released = was_held && !state_.held;
}

void Pointer::updateRay(const Vec3& center_m) {
  const xr::Space aim = session_->actionSpace(*controls_.aim, hand_);
  const Pose ray = xr::fromXr(session_->locateSpace(aim).value_or(xr::kIdentityPose));
  state_.origin_m = ray.position;
  state_.forward = ray.rotation * Vec3::UnitZ();
  const double ahead_m = center_m.z() - ray.position.z();
  state_.on_plane = ahead_m > 0.0 && state_.forward.z() > kLeastForward;
  if (state_.on_plane) {
    state_.place_m = ray.position + state_.forward * (ahead_m / state_.forward.z()) - center_m;
    state_.place_m.z() = 0.0;
  }
  const auto pulled = [this](const xr::Action* action) {
    return session_->actionState(*action, hand_).pressed();
  };
  state_.held = pulled(controls_.trigger) || pulled(controls_.squeeze);
}

void Pointer::updateTouch(const Vec3& center_m) {
  const Pose grip = controller_->transform().pose();
  state_.origin_m = grip * Vec3(0.0, 0.0, kFinger_m);
  state_.forward = grip.rotation * Vec3::UnitZ();
  const double behind_m = state_.origin_m.z() - center_m.z();
  state_.on_plane = std::abs(behind_m) < kNear_m;
  state_.place_m = state_.origin_m - center_m;
  state_.place_m.z() = 0.0;
  if (behind_m < 0.0) in_front_ = true;
  // A finger that comes from behind the panel touches nothing.
  state_.held = in_front_ && behind_m >= 0.0 && state_.on_plane;
  if (!state_.on_plane && behind_m >= 0.0) in_front_ = false;
}

void Pointer::vibrate() const { session_->applyHapticFeedback(*controls_.vibrate, hand_, kPulse); }

double Pointer::gap(const Vec3& place_m) const {
  const Vec3 way = place_m - state_.origin_m;
  if (select_ == Select::touch) return way.norm();
  return std::atan2(state_.forward.cross(way).norm(), state_.forward.dot(way));
}

}  // namespace sim2vr::games::panel

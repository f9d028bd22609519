// SPDX-License-Identifier: Apache-2.0
#include "pointing/stylus.hpp"

namespace sim2vr::games::pointing {

Pose Stylus::tipPose() const {
  return controller_->transform().pose() * Pose{{0.0, 0.0, length_m_}, Quat::Identity()};
}

std::optional<Crossing> Stylus::follow(float time_s, double plane_z_m) {
  const bool was_held = held_;
  const float last_s = time_s_;
  const Vec3 last_m = tip_m_;
  held_ = controller_->activeInHierarchy();
  time_s_ = time_s;
  velocity_mps_ = Vec3::Zero();
  if (!held_) {
    armed_ = false;
    return std::nullopt;
  }
  tip_m_ = tipPose().position;
  std::optional<Crossing> crossing;
  const double before_m = last_m.z() - plane_z_m;
  const double now_m = tip_m_.z() - plane_z_m;
  // A stylus that comes into a hand has come from nowhere.
  if (was_held) {
    const float dt_s = time_s - last_s;
    if (dt_s > 0.0F) velocity_mps_ = (tip_m_ - last_m) / static_cast<double>(dt_s);
    if (armed_ && before_m < 0.0 && now_m >= 0.0) {
      const double share = before_m / (before_m - now_m);
      Vec3 place_m = last_m + share * (tip_m_ - last_m);
      place_m.z() = plane_z_m;
      crossing = Crossing{place_m, last_s + static_cast<float>(share) * dt_s};
      armed_ = false;
    }
  }
  if (now_m < 0.0 && now_m <= -rearm_m_) armed_ = true;
  return crossing;
}

void Stylus::fields(Archive& archive) {
  archive.field("held", held_);
  archive.field("armed", armed_);
  archive.field("time_s", time_s_, kQuantities);
  archive.field("tip_m", tip_m_);
  archive.field("velocity_mps", velocity_mps_);
}

}  // namespace sim2vr::games::pointing

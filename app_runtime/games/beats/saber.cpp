// SPDX-License-Identifier: Apache-2.0
#include "beats/saber.hpp"

namespace sim2vr::games::beats {

void Saber::follow(double dt_s) {
  const bool was_held = held_;
  held_ = controller_->activeInHierarchy();
  tip_velocity_mps_ = Vec3::Zero();
  if (!held_) return;
  const Pose now = controller_->transform().pose();
  // A saber that comes into a hand has come from nowhere.
  last_pose_ = was_held ? pose_ : now;
  pose_ = now;
  if (!was_held) return;
  travel_m_ += (pose_.position - last_pose_.position).norm();
  const Vec3 tip(0.0, 0.0, blade_.tip_m);
  if (dt_s > 0.0) tip_velocity_mps_ = (pose_ * tip - last_pose_ * tip) / dt_s;
}

void Saber::fields(Archive& archive) {
  archive.field("held", held_);
  archive.field("pose", pose_);
  archive.field("last_pose", last_pose_);
  archive.field("tip_velocity", tip_velocity_mps_);
  archive.field("travel", travel_m_);
}

}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
#include "whacamole/target.hpp"

#include <algorithm>

#include "sim2vr/physics/collider.hpp"
#include "sim2vr/scene/scene.hpp"
#include "whacamole/hammer.hpp"
#include "whacamole/layers.hpp"
#include "whacamole/round.hpp"
#include "whacamole/target_looks.hpp"

namespace sim2vr::games::whacamole {
namespace {

// Hit volume in target units, reaching 2.5 mm in front of the target plane.
const Vec3 kTriggerSize(1.8, 1.8, 1.0);
const Vec3 kTriggerCenter(0.0, 0.0, -0.6);

// A collider needs some size.
constexpr float kSmallestScale = 1e-3F;
constexpr float kShortest_s = 1e-3F;

}  // namespace

Vec3 cellCenter_m(int cell, const Settings& settings) {
  const double pitch_m = settings.area_size_m / 2.0;
  const int row = cell / 3;
  const int column = cell % 3;
  return {(column - 1) * pitch_m, (1 - row) * pitch_m, 0.0};
}

Vec3 targetOrigin_m(int cell, const Settings& settings) {
  return cellCenter_m(cell, settings) + Vec3(0.0, 0.0, settings.target_radius_m);
}

void registerTargetPrefab(scene::Scene& scene, Round& round, const Hammer& hammer) {
  scene.registerPrefab(kTargetPrefab, [&round, &hammer](scene::GameObject& object) {
    object.setLayer(kTargetLayer);
    object.transform().setLocalScale(round.settings().target_radius_m);
    object.addComponent<physics::Rigidbody>();
    object.addComponent<physics::Collider>(physics::Box{kTriggerSize}, kTriggerCenter,
                                           /*is_trigger=*/true);
    object.addComponent<TargetLooks>();
    object.addComponent<Target>(round, hammer);
  });
}

double Target::radius_m() const { return round_.settings().target_radius_m; }

void Target::Awake() { looks_ = gameObject().getComponent<TargetLooks>(); }

void Target::begin(const Spawn& spawn) {
  id_ = spawn.id;
  cell_ = spawn.cell;
  transform().setLocalPosition(targetOrigin_m(cell_, round_.settings()));
  spawn_time_ = clock().fixedTime();
  spawn_frame_time_ = clock().time();
  expiry_ = spawn_time_ + (round_.settings().life_s + round_.settings().fade_in_s);
  if (round_.settings().fade_in_s <= 0.0F) state_ = State::kAlive;
  looks_->showAge(0.0);
}

Vec3 Target::hitCenter_m() const {
  return transform().position() + transform().rotation() * (kTriggerCenter * radius_m());
}

void Target::FixedUpdate() {
  if (state_ == State::kAlive && clock().fixedTime() >= expiry_) {
    endLife(/*was_hit=*/false);
    round_.recordMiss(*this);
  }
}

void Target::OnTriggerEnter(const scene::TriggerContact&) {
  if (state_ != State::kAlive) return;
  const Vec3 velocity = hammer_.velocity_mps();
  if (round_.isHit(velocity)) {
    endLife(/*was_hit=*/true);
    round_.recordHit(*this, velocity);
    return;
  }
  round_.recordContact(*this, velocity, /*first=*/!touched_);
  touched_ = true;
}

void Target::Update() {
  if (state_ == State::kFadeOut) {
    fadeOut();
    return;
  }
  const float age_s = clock().time() - spawn_time_;
  if (state_ == State::kFadeIn) fadeIn(age_s);
  if (state_ != State::kAlive) return;
  const Settings& settings = round_.settings();
  looks_->showAge((age_s - settings.fade_in_s) / std::max(settings.life_s, kShortest_s));
}

void Target::fadeIn(float age_s) {
  const float fade_in_s = round_.settings().fade_in_s;
  const bool done = age_s > fade_in_s;
  const float scale = done ? 1.0F : std::max(age_s / fade_in_s, kSmallestScale);
  transform().setLocalScale(radius_m() * scale);
  if (done) state_ = State::kAlive;
}

void Target::fadeOut() {
  const float elapsed_s = clock().time() - end_time_;
  if (elapsed_s > kFadeOut_s) {
    round_.recordRemoval(*this);
    scene().destroy(gameObject());
    return;
  }
  if (was_hit_) {
    looks_->showBurst(elapsed_s);
    return;
  }
  looks_->showMissed();
  transform().setLocalScale(radius_m() * std::max(1.0F - elapsed_s / kFadeOut_s, kSmallestScale));
}

void Target::endLife(bool was_hit) {
  state_ = State::kFadeOut;
  // A miss fades from when its life was over, not from the step that noticed it.
  end_time_ = was_hit ? clock().fixedTime() : expiry_;
  was_hit_ = was_hit;
}

void Target::fields(Archive& archive) {
  archive.field("state", state_, State::kFadeOut);
  archive.field("id", id_, kCounts);
  archive.field("cell", cell_, {0.0, kCells - 1});
  archive.field("spawn_time", spawn_time_, kQuantities);
  archive.field("spawn_frame_time", spawn_frame_time_, kQuantities);
  archive.field("expiry", expiry_, kQuantities);
  archive.field("end_time", end_time_, kQuantities);
  archive.field("touched", touched_);
  archive.field("was_hit", was_hit_);
}

}  // namespace sim2vr::games::whacamole

// SPDX-License-Identifier: Apache-2.0
#include "pointing/round.hpp"

#include <fmt/format.h>
#include <array>
#include <utility>

#include "pointing/looks.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::games::pointing {
namespace {

// 20 ms at half strength, at the frequency that the controller likes best.
constexpr XrHapticVibration kPulse{XR_TYPE_HAPTIC_VIBRATION, nullptr, 20'000'000,
                                   XR_FREQUENCY_UNSPECIFIED, 0.5F};

// Frames lie a hair beside the times that they are meant for; no rounding shall decide in which of
// them a target goes away.
constexpr float kTimeTolerance_s = 1e-3F;

}  // namespace

Feedback::Feedback(xr::Session& session, rl::SoundLog& sounds, xr::Hand hand)
    : session_(&session), sounds_(&sounds), hand_(hand) {
  xr::ActionSet& set = session.createActionSet("pointing");
  xr::Action& vibration =
      session.createAction(set, "vibrate", XR_ACTION_TYPE_VIBRATION_OUTPUT, {hand});
  session.suggestBinding(vibration, hand == xr::Hand::left ? "/user/hand/left/output/haptic"
                                                           : "/user/hand/right/output/haptic");
  vibration_ = &vibration;
}

void Feedback::selection(std::string_view sound, const Vec3& place_m) {
  sounds_->play({std::string(sound), place_m});
  session_->applyHapticFeedback(*vibration_, hand_, kPulse);
}

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

Round::Round(RoundSetup setup)
    : setup_(std::move(setup)), blocks_(drawBlocks(setup_.settings, setup_.seed)) {}

void Round::Update() {
  switch (phase_) {
    case Phase::kReady:
      begin();
      break;
    case Phase::kPlay:
      play();
      break;
    case Phase::kDone:
      break;
  }
}

void Round::begin() {
  const Vec3 head_m = setup_.rig.camera->transform().position();
  center_m_ = head_m + settings().center_m();
  placeCameras(scene(), head_m, settings().hand);
  setup_.stylus.follow(clock().time(), center_m_.z());
  phase_ = Phase::kPlay;
  openLog();
  logBlock();
  putUp();
}

void Round::play() {
  const auto crossing = setup_.stylus.follow(clock().time(), center_m_.z());
  logState();
  if (crossing) {
    select(*crossing);
  } else if (age_s() >= settings().timeout_s - kTimeTolerance_s) {
    timeOut();
  }
}

void Round::putUp() {
  appeared_s_ = clock().time();
  logTarget();
}

void Round::select(const Crossing& crossing) {
  const Vec3 goal_m = targetCenter(target());
  const bool hit = (crossing.place_m - goal_m).norm() <= block().width_m / 2.0;
  std::optional<Movement> movement;
  if (began_) {
    const Vec3 from_m = targetCenter(targetOfTrial(trial_ - 1, settings().targets));
    const double time_s = static_cast<double>(crossing.time_s - began_->time_s);
    movement = movementOf(from_m, goal_m, began_->place_m, crossing.place_m, time_s);
    sums_.add(*movement);
    tally_.add(*movement, block().index_bits());
  }
  ++(hit ? tally_.hits : tally_.errors);
  logSelection(hit, crossing, movement);
  if (hit) {
    setup_.feedback.hit(crossing.place_m);
  } else {
    setup_.feedback.error(crossing.place_m);
  }
  endTrial(hit ? Outcome::kHit : Outcome::kError, Selection{crossing.place_m, crossing.time_s});
}

void Round::timeOut() {
  ++tally_.timeouts;
  logTimeout();
  setup_.feedback.timeout(targetCenter(target()));
  endTrial(Outcome::kTimeout, std::nullopt);
}

void Round::endTrial(Outcome outcome, const std::optional<Selection>& selection) {
  last_outcome_ = outcome;
  last_center_m_ = targetCenter(target());
  last_width_m_ = block().width_m;
  last_outcome_s_ = clock().time();
  began_ = selection;
  if (trial_ == settings().targets) {
    endBlock();
    if (phase_ == Phase::kDone) return;
  } else {
    ++trial_;
  }
  ++target_id_;
  putUp();
}

void Round::endBlock() {
  const std::optional<Effective> effective = sums_.effective();
  if (effective) tally_.add(*effective);
  logBlockEnd(effective);
  sums_ = MovementSums();
  began_.reset();
  if (block_ + 1 == static_cast<int>(blocks_.size())) {
    finish();
    return;
  }
  ++block_;
  trial_ = 0;
  logBlock();
}

void Round::finish() {
  phase_ = Phase::kDone;
  closeLog();
}

double Round::progress() const {
  if (phase_ == Phase::kDone) return 1.0;
  const int trials = settings().targets + 1;
  return static_cast<double>(block_ * trials + trial_) /
         (static_cast<double>(blocks_.size()) * trials);
}

Vec3 Round::targetCenter(int target) const {
  return center_m_ + targetCenter_m(target, settings().targets, block().distance_m);
}

std::optional<int> Round::nextTarget() const {
  if (trial_ == settings().targets) return std::nullopt;
  return targetOfTrial(trial_ + 1, settings().targets);
}

void Round::fields(Archive& archive) {
  archive.field("stylus", setup_.stylus);
  archive.field("phase", phase_, Phase::kDone);
  archive.field("block", block_, {0.0, static_cast<double>(blocks_.size() - 1)});
  archive.field("trial", trial_, {0.0, static_cast<double>(settings().targets)});
  archive.field("target_id", target_id_, kCounts);
  archive.field("appeared_s", appeared_s_, kQuantities);
  archive.field("center_m", center_m_);
  archive.field("began", began_);
  archive.field("sums", sums_);
  archive.field("tally", tally_);
  archive.field("last_outcome", last_outcome_, Outcome::kTimeout);
  archive.field("last_center_m", last_center_m_);
  archive.field("last_width_m", last_width_m_, kQuantities);
  archive.field("last_outcome_s", last_outcome_s_, kQuantities);
}

namespace {

/// "x y" from the circle's centre.
std::string inPlane(const Vec3& place_m, const Vec3& center_m) {
  const Vec3 from_center = place_m - center_m;
  return rl::formatFloat(from_center.x()) + " " + rl::formatFloat(from_center.y());
}

}  // namespace

void Round::openLog() {
  if (setup_.logger == nullptr) return;
  static const std::vector<std::string> kPoses{"left", "right", "head", "tip"};
  setup_.logger->beginRound("pointing", setup_.seed, kPoses);
  logState();
  const float now_s = clock().time();
  const std::string options = settings().playOptionsJson();
  if (options != "{}") setup_.logger->event(now_s, "game options " + options);
  setup_.logger->event(now_s,
                       "target plane transform " + rl::formatPose({center_m_, Quat::Identity()}));
}

void Round::logState() {
  if (setup_.logger == nullptr) return;
  const auto pose_of = [](const scene::GameObject& controller) {
    return controller.activeInHierarchy() ? controller.transform().pose() : Pose{};
  };
  const std::array<Pose, 4> poses{pose_of(*setup_.rig.left_controller),
                                  pose_of(*setup_.rig.right_controller),
                                  setup_.rig.camera->transform().pose(), setup_.stylus.tipPose()};
  setup_.logger->state(clock().time(), poses);
}

void Round::logBlock() {
  if (setup_.logger == nullptr) return;
  setup_.logger->event(
      clock().time(),
      fmt::format("block_start, block {}, distance {}, width {}, index {}, targets {}", block_,
                  rl::formatFloat(block().distance_m), rl::formatFloat(block().width_m),
                  rl::formatFloat(block().index_bits()), settings().targets));
}

void Round::logTarget() {
  if (setup_.logger == nullptr) return;
  setup_.logger->event(clock().time(),
                       fmt::format("target_spawn, target ID {}, grid ID {}, block {}, trial {}, "
                                   "center {}",
                                   target_id_, target(), block_, trial_,
                                   inPlane(targetCenter(target()), center_m_)));
}

void Round::logSelection(bool hit, const Crossing& crossing,
                         const std::optional<Movement>& movement) {
  if (setup_.logger == nullptr) return;
  std::string text = fmt::format("{}, target ID {}, grid ID {}, block {}, trial {}, place {}",
                                 hit ? "target_hit" : "target_error", target_id_, target(), block_,
                                 trial_, inPlane(crossing.place_m, center_m_));
  if (movement) {
    text +=
        fmt::format(", movement time {}, offset {}, length {}", rl::formatFloat(movement->time_s),
                    rl::formatFloat(movement->offset_m), rl::formatFloat(movement->length_m));
  }
  setup_.logger->event(crossing.time_s, text);
}

void Round::logTimeout() {
  if (setup_.logger == nullptr) return;
  setup_.logger->event(clock().time(),
                       fmt::format("target_miss, target ID {}, grid ID {}, block {}, trial {}",
                                   target_id_, target(), block_, trial_));
}

void Round::logBlockEnd(const std::optional<Effective>& effective) {
  if (setup_.logger == nullptr) return;
  std::string text = fmt::format("block_end, block {}, movements {}", block_, sums_.count());
  if (effective) {
    text += fmt::format(
        ", movement time {}, effective distance {}, effective width {}, effective index {}, "
        "throughput {}",
        rl::formatFloat(effective->movement_time_s), rl::formatFloat(effective->distance_m),
        rl::formatFloat(effective->width_m()), rl::formatFloat(effective->index_bits()),
        rl::formatFloat(effective->throughput_bps()));
  }
  setup_.logger->event(clock().time(), text);
}

void Round::closeLog() {
  if (setup_.logger == nullptr) return;
  setup_.logger->event(clock().time(),
                       fmt::format("episode statistics, hits {}, errors {}, timeouts {}",
                                   tally_.hits, tally_.errors, tally_.timeouts));
  setup_.logger->endRound();
}

}  // namespace sim2vr::games::pointing

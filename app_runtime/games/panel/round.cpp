// SPDX-License-Identifier: Apache-2.0
#include "panel/round.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "panel/looks.hpp"
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

// Frames lie a hair beside the times that they are meant for.
constexpr float kTimeTolerance_s = 1e-3F;
constexpr float kFlash_s = 0.2F;

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

double Tally::meanTime_s() const {
  if (times_s.empty()) return 0.0;
  return std::accumulate(times_s.begin(), times_s.end(), 0.0) / static_cast<double>(times_s.size());
}

double Tally::medianTime_s() const {
  if (times_s.empty()) return 0.0;
  std::vector<float> sorted = times_s;
  std::sort(sorted.begin(), sorted.end());
  const std::size_t half = sorted.size() / 2;
  if (sorted.size() % 2 == 1) return sorted[half];
  return (static_cast<double>(sorted[half - 1]) + sorted[half]) / 2.0;
}

void Tally::fields(Archive& archive) {
  archive.field("targets", targets, kCounts);
  archive.field("hits", hits, kCounts);
  archive.field("errors", errors, kCounts);
  archive.field("missed_first", missed_first, kCounts);
  archive.field("timeouts", timeouts, kCounts);
  archive.field("times_s", times_s, kQuantities);
}

Round::Round(RoundSetup setup)
    : setup_(std::move(setup)), random_(setup_.seed), widgets_(makeWidgets(setup_.settings)) {}

void Round::Awake() {
  for (const auto& widget : widgets_) widget->build(gameObject());
}

void Round::Update() {
  if (over_) return;
  const float before_s = now_s_;
  now_s_ = clock().time();
  if (!begun_) begin();
  for (Pointer& pointer : setup_.pointers) pointer.update(center_m_);
  logState();
  for (std::size_t which = 0; which < setup_.pointers.size() && !over_; ++which) {
    const Pointer& pointer = setup_.pointers[which];
    if (!pointer.state().held && pointer.state().on_plane) {
      for (const auto& widget : widgets_) {
        if (widget->contains(pointer.state().place_m)) {
          widget->hover(pointer.state(), now_s_ - before_s);
        }
      }
    }
    operate(which);
  }
  if (now_s_ - appeared_s_ >= settings().timeout_s - kTimeTolerance_s) endTarget(false);
  over_ = now_s_ - start_s_ >= settings().round_s - kTimeTolerance_s;
}

void Round::begin() {
  begun_ = true;
  start_s_ = now_s_;
  const Vec3 head_m = setup_.rig.camera->transform().position();
  center_m_ = head_m + settings().center_m();
  transform().setPosition(center_m_);
  placeCameras(scene(), head_m, center_m_);
  openLog();
  lit_ = random_.range(0, static_cast<int>(widgets_.size()));
  widgets_[static_cast<std::size_t>(lit_)]->drawGoal(random_);
  appeared_s_ = now_s_;
  logTarget();
}

void Round::light() {
  if (widgets_.size() > 1) {
    const int other = random_.range(0, static_cast<int>(widgets_.size()) - 1);
    lit_ = other + (other >= lit_ ? 1 : 0);
  }
  widgets_[static_cast<std::size_t>(lit_)]->drawGoal(random_);
  appeared_s_ = now_s_;
  erred_ = false;
  ++target_id_;
  logTarget();
}

void Round::operate(std::size_t which) {
  const Pointer& pointer = setup_.pointers[which];
  const PointerState& state = pointer.state();
  int& grabbed = grabbed_.at(which);
  if (state.pressed) {
    grabbed = -1;
    for (std::size_t i = 0; i < widgets_.size() && state.on_plane; ++i) {
      if (widgets_[i]->contains(state.place_m)) grabbed = static_cast<int>(i);
    }
    // A ray that is pulled beside everything is an error; a finger in the air is none.
    if (grabbed < 0) {
      if (settings().select == Select::ray) decide(-1, false, pointer);
      return;
    }
    decide(grabbed, widgets_[static_cast<std::size_t>(grabbed)]->press(state), pointer);
  } else if (grabbed >= 0) {
    Widget& widget = *widgets_[static_cast<std::size_t>(grabbed)];
    if (state.held) {
      widget.hold(state);
    } else {
      decide(std::exchange(grabbed, -1), widget.release(state), pointer);
    }
  }
}

void Round::decide(int widget, Result result, const Pointer& pointer) {
  if (!result) return;
  const bool hit = widget == lit_ && *result;
  pointer.vibrate();
  const Vec3 place_m = center_m_ + pointer.state().place_m;
  setup_.sounds->play({hit ? "hit" : "error", place_m});
  last_ = hit ? Flash::hit : Flash::error;
  last_s_ = now_s_;
  logOutcome(hit ? "target_hit" : "target_error", &pointer.state().place_m);
  if (hit) {
    endTarget(true);
    return;
  }
  ++tally_.errors;
  erred_ = true;
}

void Round::endTarget(bool hit) {
  ++tally_.targets;
  if (erred_) ++tally_.missed_first;
  if (hit) {
    ++tally_.hits;
    tally_.times_s.push_back(now_s_ - appeared_s_);
  } else {
    ++tally_.timeouts;
    logOutcome("target_miss", nullptr);
  }
  light();
}

double Round::progress() const {
  if (over_) return 1.0;
  return std::clamp<double>((now_s_ - start_s_) / settings().round_s, 0.0, 1.0);
}

Round::Flash Round::flash() const { return now_s_ - last_s_ < kFlash_s ? last_ : Flash::none; }

void Round::fields(Archive& archive) {
  archive.field("random", random_);
  for (const auto& widget : widgets_) archive.field("widget", *widget);
  for (Pointer& pointer : setup_.pointers) archive.field("pointer", pointer);
  archive.field("begun", begun_);
  archive.field("over", over_);
  archive.field("start_s", start_s_, kQuantities);
  archive.field("now_s", now_s_, kQuantities);
  archive.field("center_m", center_m_);
  archive.field("lit", lit_, {0.0, static_cast<double>(widgets_.size() - 1)});
  archive.field("target_id", target_id_, kCounts);
  archive.field("appeared_s", appeared_s_, kQuantities);
  archive.field("erred", erred_);
  archive.field("grabbed", grabbed_, {-1.0, static_cast<double>(widgets_.size() - 1)});
  archive.field("tally", tally_);
  archive.field("last", last_, Flash::error);
  archive.field("last_s", last_s_, kQuantities);
}

namespace {

std::string inPlane(const Vec3& place_m) {
  return rl::formatFloat(place_m.x()) + " " + rl::formatFloat(place_m.y());
}

}  // namespace

void Round::openLog() {
  if (setup_.logger == nullptr) return;
  static const std::vector<std::string> kPoses{"left", "right", "head"};
  setup_.logger->beginRound("panel", setup_.seed, kPoses);
  setup_.logger->event(now_s_, "panel transform " + rl::formatPose({center_m_, Quat::Identity()}));
}

void Round::logState() {
  if (setup_.logger == nullptr) return;
  const auto pose_of = [](const scene::GameObject& controller) {
    return controller.activeInHierarchy() ? controller.transform().pose() : Pose{};
  };
  const std::array<Pose, 3> poses{pose_of(*setup_.rig.left_controller),
                                  pose_of(*setup_.rig.right_controller),
                                  setup_.rig.camera->transform().pose()};
  setup_.logger->state(now_s_, poses);
}

void Round::logTarget() {
  if (setup_.logger == nullptr) return;
  const Widget& widget = *widgets_[static_cast<std::size_t>(lit_)];
  setup_.logger->event(
      now_s_, fmt::format("target_spawn, target ID {}, grid ID {}, kind {}, center {}, width {}",
                          target_id_, lit_, widget.kind(), inPlane(widget.handle_m()),
                          rl::formatFloat(widget.width_m())));
}

void Round::logOutcome(const char* event, const Vec3* place_m) {
  if (setup_.logger == nullptr) return;
  std::string text = fmt::format("{}, target ID {}, grid ID {}, age {}", event, target_id_, lit_,
                                 rl::formatFloat(static_cast<double>(now_s_ - appeared_s_)));
  if (place_m != nullptr) text += ", place " + inPlane(*place_m);
  setup_.logger->event(now_s_, text);
}

}  // namespace sim2vr::games::panel

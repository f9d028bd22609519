// SPDX-License-Identifier: Apache-2.0
#include "panel/round.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "panel/looks.hpp"

namespace sim2vr::games::panel {
namespace {

// Frames lie a hair beside the times that they are meant for.
constexpr float kTimeTolerance_s = 1e-3F;
constexpr float kFlash_s = 0.2F;

}  // namespace

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

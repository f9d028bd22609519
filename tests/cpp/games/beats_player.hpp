// SPDX-License-Identifier: Apache-2.0
// Rounds of Beats on levels made by hand, and a player whose blades lie along z: what the blade
// does at a box is then what the hand does.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "beats/game.hpp"
#include "beats/round.hpp"
#include "game_harness.hpp"
#include "sim2vr/xr/frames.hpp"

namespace sim2vr::games::beats {

/// Slow enough that little happens between two frames: 0.1 m at 20 Hz.
inline Level emptyLevel(double length_s = 10.0) {
  Level level;
  level.name = "by hand";
  level.length_s = length_s;
  level.speed_mps = 2.0;
  level.approach_s = 2.0;
  level.hash = "0123456789abcdef";
  return level;
}

/// Beats on a given level.
class LevelGame : public Beats {
 public:
  explicit LevelGame(Level level) : level_(std::make_shared<const Level>(std::move(level))) {}

  void configure(Options& options) override { settings_ = Settings::fromOptions(options); }
  rl::RLEnv& build(rl::GameContext& context) override {
    return buildRound(context, settings_, level_);
  }

 private:
  std::shared_ptr<const Level> level_;
  Settings settings_;
};

/// The head starts at (0, 1.2, 0): the middle of cell (2, 1) is at (0.2, 0.9), the cut plane at z =
/// 0.8. Hands wait far to either side.
struct Stance {
  Vec3 head{0.0, 1.2, 0.0};
  Pose left{{-3.0, 0.9, 0.0}, Quat::Identity()};
  Pose right{{3.0, 0.9, 0.0}, Quat::Identity()};
  bool left_on = true;
  bool right_on = true;
};

class BeatsRound {
 public:
  /// Frames of 20 Hz lie where the reference's do.
  explicit BeatsRound(const Level& level,
                      const std::string& options_json = R"({"end_on_miss": false})",
                      std::int64_t period_ns = 49'999'997, rl::EpisodeLogger* logger = nullptr)
      : game(level), harness(game, 1, options_json, time(), 0, logger), period_ns_(period_ns) {}

  void frame(const Stance& stance) {
    xr::DeviceState state;
    state.head = xr::toXr(Pose{stance.head, Quat::Identity()});
    const auto hold = [&state](xr::Hand hand, const Pose& pose, bool on) {
      xr::ControllerState& controller = state.hand(hand);
      controller.active = on;
      controller.grip = xr::toXr(pose);
      controller.aim = controller.grip;
    };
    hold(xr::Hand::left, stance.left, stance.left_on);
    hold(xr::Hand::right, stance.right, stance.right_on);
    harness.frame(frames_++ * period_ns_, state);
    if (rewards) rewards_ += harness.env().reward();
  }
  /// Until the round's time is that of the level or a little less.
  void waitUntil(double time_s, const Stance& stance = {}) {
    while (static_cast<double>(frames_ * period_ns_) * 1e-9 <= time_s + 1e-6) frame(stance);
  }
  /// One frame in which the hand's blade goes from where it is to `to`, starting anywhere.
  void stroke(Hand hand, const Vec3& from, const Vec3& to) {
    for (const Vec3& place : {from, to}) {
      Stance stance;
      (hand == Hand::kLeft ? stance.left : stance.right).position = place;
      frame(stance);
    }
  }

  Round& round() { return *harness.all<Round>().at(0); }
  const Tally& tally() { return round().tally(); }
  std::int64_t frames() const { return frames_; }
  double rewardSum() const { return rewards_; }

  LevelGame game;
  testing::GameHarness harness;
  bool rewards = true;

 private:
  // Long frames count in full.
  static TimeSettings time() {
    TimeSettings settings = testing::referenceTime();
    settings.maximum_delta_time_s = 10.0;
    return settings;
  }

  std::int64_t period_ns_;
  std::int64_t frames_ = 0;
  double rewards_ = 0.0;
};

}  // namespace sim2vr::games::beats

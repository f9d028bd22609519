// SPDX-License-Identifier: Apache-2.0
// Beats: cut the boxes that come in time with a beat, in the direction they show, leave mines alone
// and keep the head out of walls. Rules, numbers and reward: docs/reference/games/beats.md.
#pragma once

#include <limits>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "beats/round.hpp"
#include "beats/settings.hpp"
#include "sim2vr/rl/game.hpp"

namespace sim2vr::games::beats {

// Privileged observations: the numbers behind the picture that a teacher learns from.
// Objects are listed from the frame in which the camera could see them within 10 m. Positions are
// in metres, minus the head if nothing else is said.
// - head.x_m .. z_m: head minus origin
// - left., right.: root_x_m ..: lower end of the blade; axis_x ..: unit vector to the tip;
//   tip_vx_mps ..; on
// - left0., left1., right0., right1.: next two boxes of each hand: present; time_s until the cut
//   plane; x_m ..; dir_x, dir_y (0, 0: any)
// - mine0. .. mine2.: present, time_s, x_m ..
// - wall0., wall1.: present; start_s, end_s until front and back reach the head plane; left_m,
//   right_m, bottom_m, top_m
// - round.speed_mps: v
// - aid.left_m, .right_m, .wall_m: distance from the blade to its next box; depth of the head in
//   wall0
// - aid.score, .misses, .errors, .slices: sums over the round

/// How many are reported: of each hand's boxes, of mines, of walls.
inline constexpr std::size_t kShownBoxes = 2;
inline constexpr std::size_t kShownMines = 3;
inline constexpr std::size_t kShownWalls = 2;

const std::vector<std::string>& privilegedNames();

/// Writes one value for each of privilegedNames().
void writePrivileged(const Round& round, const Sight& sight, std::span<float> values);

// What a learner sees of the game.

class Env : public rl::RLEnv {
 public:
  /// `aspect`: width / height of the headset image. The round outlives it.
  Env(const Round& round, double aspect) : round_(round), sight_(round, aspect) {}

  std::string_view typeName() const override { return "beats.Env"; }
  void declareLog() override;
  double calculateReward() override;
  bool isOver() const override { return round_.phase() == Round::Phase::kDone; }
  float timeFeature() const override;
  void fillPrivileged(std::span<float> values) const override;
  void fields(Archive& archive) override;

 private:
  double approachReward() const;

  const Round& round_;
  Sight sight_;
  // As they were in the frame before.
  int score_ = 0;
  int misses_ = 0;
  double errors_ = 0.0;
  // Of the present frame; NaN, which clients do not get, of a round without.
  double approach_ = std::numeric_limits<double>::quiet_NaN();
  double penalty_ = std::numeric_limits<double>::quiet_NaN();
};

class Beats : public rl::Game {
 public:
  std::string_view name() const override { return "beats"; }
  std::string_view description() const override {
    return "Cut boxes that come with the beat with two sabers, dodge walls and mines";
  }
  rl::GameFacts facts() const override;
  void configure(Options& options) override { settings_ = Settings::fromOptions(options); }
  rl::RLEnv& build(rl::GameContext& context) override;
  const std::vector<std::string>& privilegedNames() const override;
  std::string timelineJson(std::uint32_t seed) const override;

 private:
  Settings settings_;
};

/// A round of a level, wherever that came from: what Beats::build does with its own.
rl::RLEnv& buildRound(rl::GameContext& context, const Settings& settings,
                      std::shared_ptr<const Level> level);

}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
// Whac-A-Mole: hit the targets that come up in a 3 x 3 grid, for 60 s. Rules, numbers and reward:
// docs/reference/games/whacamole.md.
#pragma once

#include <array>
#include <span>
#include <string>
#include <vector>

#include "sim2vr/rl/game.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "whacamole/conditions.hpp"
#include "whacamole/round.hpp"

namespace sim2vr::games::whacamole {

// What a teacher may know of a round: the numbers behind the picture, as far as the head camera has
// shown them. docs/reference/games/whacamole.md, "Privileged observations".

/// Reports targets while they grow or live, once their middle has been in the head camera's view.
class Privileged {
 public:
  /// How many targets are reported in order of urgency, next to the cells.
  static constexpr int kNext = 3;
  /// In front of a cell by this much lies where a stroke may begin.
  static constexpr double kStrokeStart_m = 0.10;
  /// The aid for striking falls off with the distance to the nearest target.
  static constexpr double kStrikeReach_m = 0.08;

  /// `aspect`: width / height of the headset image. Everything outlives it.
  Privileged(const Round& round, const scene::GameObject& camera, const scene::GameObject& area,
             double aspect)
      : round_(&round), camera_(&camera), area_(&area), aspect_(aspect) {}

  static const std::vector<std::string>& names();

  /// At the end of every frame: notices the targets in view and adds to the aids.
  void look();
  /// Writes one value for each of names().
  void fill(std::span<float> values) const;
  void fields(Archive& archive);

 private:
  /// Targets that the head camera has shown, the one that expires first in front.
  std::vector<const Target*> shown() const;
  void addToAids();

  const Round* round_;
  const scene::GameObject* camera_;
  const scene::GameObject* area_;
  double aspect_;
  /// By cell, the latest target there that was in view; -1 before the first.
  std::array<int, kCells> seen_ids_{-1, -1, -1, -1, -1, -1, -1, -1, -1};
  bool has_marker_ = false;
  Vec3 marker_m_ = Vec3::Zero();
  Vec3 marker_velocity_mps_ = Vec3::Zero();
  double progress_sum_m_ = 0.0;
  double strike_sum_ = 0.0;
};

class WhacAMole : public rl::Game {
 public:
  std::string_view name() const override { return "whacamole"; }
  std::string_view description() const override {
    return "Hit the targets that come up in a 3 x 3 grid with a hammer";
  }
  rl::GameFacts facts() const override;
  void configure(Options& options) override;
  rl::RLEnv& build(rl::GameContext& context) override;
  std::optional<double> headRequest(std::uint32_t seed) const override;
  const std::vector<std::string>& privilegedNames() const override;
  void fields(Archive& archive) override;

 private:
  Settings settings_;
  CellTally tally_;  // of the current round; the next one's curriculum starts from it
};

}  // namespace sim2vr::games::whacamole

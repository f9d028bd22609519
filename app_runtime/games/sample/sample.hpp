// SPDX-License-Identifier: Apache-2.0
// "Touch the ball": the game to copy. See docs/reference/games/sample.md.
#pragma once

#include "sim2vr/rl/game.hpp"

namespace sim2vr::games::sample {

class TouchTheBall : public rl::Game {
 public:
  std::string_view name() const override { return "sample"; }
  std::string_view description() const override {
    return "Touch the ball with the right controller; the game to copy";
  }
  rl::GameFacts facts() const override;
  void configure(Options& options) override;
  rl::RLEnv& build(rl::GameContext& context) override;

 private:
  double ball_radius_m_ = 0.05;
  double round_s_ = 20.0;
};

}  // namespace sim2vr::games::sample

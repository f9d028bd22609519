// SPDX-License-Identifier: Apache-2.0
// Beats: cut the boxes that come in time with a beat, in the direction they show, leave mines alone
// and keep the head out of walls. Rules, numbers and reward: docs/reference/games/beats.md.
#pragma once

#include <memory>

#include "beats/settings.hpp"
#include "sim2vr/rl/game.hpp"

namespace sim2vr::games::beats {

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

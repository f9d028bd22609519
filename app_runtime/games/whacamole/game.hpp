// SPDX-License-Identifier: Apache-2.0
// Whac-A-Mole: hit the targets that come up in a 3 x 3 grid, for 60 s. Rules, numbers and reward:
// docs/reference/games/whacamole.md.
#pragma once

#include "sim2vr/rl/game.hpp"
#include "whacamole/conditions.hpp"
#include "whacamole/round.hpp"

namespace sim2vr::games::whacamole {

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

// SPDX-License-Identifier: Apache-2.0
// "Pointing": the multi-directional tapping task of ISO 9241-411, in VR. See
// docs/reference/games/pointing.md.
#pragma once

#include "pointing/settings.hpp"
#include "sim2vr/rl/game.hpp"

namespace sim2vr::games::pointing {

class Pointing : public rl::Game {
 public:
  std::string_view name() const override { return "pointing"; }
  std::string_view description() const override {
    return "Tap targets on a circle in turn with a stylus, as in ISO 9241-411";
  }
  rl::GameFacts facts() const override;
  void configure(Options& options) override { settings_ = Settings::fromOptions(options); }
  rl::RLEnv& build(rl::GameContext& context) override;
  std::optional<double> headRequest(std::uint32_t seed) const override;
  const std::vector<std::string>& privilegedNames() const override;

 private:
  Settings settings_;
};

}  // namespace sim2vr::games::pointing

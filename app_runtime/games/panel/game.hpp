// SPDX-License-Identifier: Apache-2.0
// "Panel": buttons, sliders, a dial and a list, operated by a ray or a fingertip. See
// docs/reference/games/panel.md.
#pragma once

#include "panel/widget.hpp"
#include "sim2vr/rl/game.hpp"

namespace sim2vr::games::panel {

class Panel : public rl::Game {
 public:
  std::string_view name() const override { return "panel"; }
  std::string_view description() const override {
    return "Operate buttons, sliders, a dial and a list by a ray or a fingertip";
  }
  rl::GameFacts facts() const override;
  void configure(Options& options) override { settings_ = Settings::fromOptions(options); }
  rl::RLEnv& build(rl::GameContext& context) override;

 private:
  Settings settings_;
};

}  // namespace sim2vr::games::panel

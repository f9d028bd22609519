// SPDX-License-Identifier: Apache-2.0
// "Pointing": the multi-directional tapping task of ISO 9241-411, in VR. See
// docs/reference/games/pointing.md.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointing/round.hpp"
#include "pointing/rules.hpp"
#include "sim2vr/rl/game.hpp"

namespace sim2vr::games::pointing {

// What a teacher may know of a round: the numbers behind the picture, as far as the head camera has
// shown them. docs/reference/games/pointing.md, "Privileged observations".

class Privileged {
 public:
  /// In front of a target by this much lies where a tap may begin.
  static constexpr double kTapStart_m = 0.05;

  /// `aspect`: width / height of the headset image. Everything outlives it.
  Privileged(const Round& round, const scene::GameObject& camera, double aspect)
      : round_(&round), camera_(&camera), aspect_(aspect) {}

  static const std::vector<std::string>& names();

  /// At the end of every frame: notices the target when it is in view.
  void look();
  /// Writes one value for each of names().
  void fill(std::span<float> values) const;
  void fields(Archive& archive);

 private:
  bool seen() const;
  double startDistance_m() const;

  const Round* round_;
  const scene::GameObject* camera_;
  double aspect_;
  /// The latest target that was in view; -1 before the first.
  int seen_id_ = -1;
};

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

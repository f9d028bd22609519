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

// Privileged observations: the numbers behind the picture, as far as the head camera has shown
// them. Positions are in metres. The target is listed from the first frame in which its centre is
// in the camera's view.
// - round.side_m, .height_m, .depth_m, .progress: circle's centre from the head at the start;
//   proportion of trials done
// - tip.x_m .., .vx_mps .., .depth_m, .armed: minus head; velocity; behind the plane; whether the
//   next passage selects
// - target.present, .start, .width_m, .age_s, .x_m .., .place_x_m ..: start: first trial of a
//   block; centre minus tip, minus head
// - next.present, .place_x_m ..: the following target, minus head
// - shown.x0 .. x7, shown.y0 .. y7: 1 where the target is more than -14, -10 .. 14 cm right of, or
//   above, the circle's centre
// - shown.width0, .width1: wider than 2.5, 3.75 cm
// - aid.start_distance_m, aid.start_cell: from the tip to 5 cm before a target; 0

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

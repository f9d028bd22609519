// SPDX-License-Identifier: Apache-2.0
// What a learner sees of the game.
#pragma once

#include <limits>

#include "beats/sight.hpp"
#include "sim2vr/rl/game.hpp"

namespace sim2vr::games::beats {

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

}  // namespace sim2vr::games::beats

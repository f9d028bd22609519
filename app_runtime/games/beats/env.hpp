// What a learner sees of the game.
#pragma once

#include "beats/sight.hpp"
#include "sim2vr/rl/game.hpp"

namespace sim2vr::games::beats {

class Env : public rl::RLEnv {
 public:
  /// `aspect`: width / height of the headset image. The round outlives it.
  Env(const Round& round, double aspect) : round_(round), sight_(round, aspect) {}

  std::string_view typeName() const override { return "beats.Env"; }
  void InitialiseGame() override;
  void InitialiseReward() override;
  void CalculateReward() override;
  void UpdateIsFinished() override { finished_ = round_.phase() == Round::Phase::kDone; }
  float GetTimeFeature() const override;
  void fillPrivileged(std::span<float> values) const override;
  void fields(Archive& archive) override;

 private:
  double approachReward() const;
  void updateLog();

  const Round& round_;
  Sight sight_;
  // As they were in the frame before.
  int score_ = 0;
  int misses_ = 0;
  double errors_ = 0.0;
};

}  // namespace sim2vr::games::beats

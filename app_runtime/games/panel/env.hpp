// The panel as a learning problem: reward, end, time feature and the log dictionary.
#pragma once

#include "panel/round.hpp"
#include "sim2vr/rl/game.hpp"

namespace sim2vr::games::panel {

/// Reward of a frame: 10 for a widget operated as wanted, minus the error's cost for anything else
/// that was operated, plus (exp(-5 g) - 1) / 10 per user step, with g the angle, rad, or the
/// distance, m, of the nearer hand from what has to be pressed. "sparse" leaves the last term out.
class Env : public rl::RLEnv {
 public:
  explicit Env(const Round& round) : round_(round) {}

  std::string_view typeName() const override { return "panel.Env"; }
  void declareLog() override;
  double calculateReward() override;
  bool isOver() const override { return round_.over(); }
  float timeFeature() const override {
    return static_cast<float>(2.0 * round_.progress() - 1.0);
  }
  void fields(Archive& archive) override;

 private:
  double closenessReward() const;

  const Round& round_;
  int hits_ = 0;
  int errors_ = 0;
  // Of the present frame.
  double error_ = 0.0;
  double closeness_ = 0.0;
};

}  // namespace sim2vr::games::panel

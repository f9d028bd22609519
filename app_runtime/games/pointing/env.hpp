// Pointing as a learning problem: reward, end, time feature and the log dictionary.
#pragma once

#include <span>
#include <utility>

#include "pointing/privileged.hpp"
#include "pointing/round.hpp"
#include "sim2vr/rl/game.hpp"

namespace sim2vr::games::pointing {

/// Reward of a frame: 10 for a hit, minus the error's cost for a selection beside the target, plus
/// (exp(-10 d) - 1) / 10 per user step with d, m, from the tip to the centre of the target that is
/// up. "sparse" leaves the last term out.
class Env : public rl::RLEnv {
 public:
  Env(const Round& round, Privileged privileged)
      : round_(round), privileged_(std::move(privileged)) {}

  std::string_view typeName() const override { return "pointing.Env"; }
  void declareLog() override;
  double calculateReward() override;
  bool isOver() const override { return round_.phase() == Round::Phase::kDone; }
  float timeFeature() const override {
    return static_cast<float>(2.0 * round_.progress() - 1.0);
  }
  void fillPrivileged(std::span<float> values) const override { privileged_.fill(values); }
  void fields(Archive& archive) override;

 private:
  double distanceReward() const;

  const Round& round_;
  Privileged privileged_;
  int hits_ = 0;
  int errors_ = 0;
  // Of the present frame.
  double error_ = 0.0;
  double distance_ = 0.0;
};

}  // namespace sim2vr::games::pointing

// Whac-A-Mole as a learning problem: reward, end, time feature and the log dictionary.
#pragma once

#include <optional>
#include <span>
#include <utility>

#include "sim2vr/rl/game.hpp"
#include "whacamole/privileged.hpp"
#include "whacamole/round.hpp"

namespace sim2vr::games::whacamole {

/// Reward of a frame:
///   reference  10 dPoints + 2 dFirstContacts max(0, s) / 0.8 + sum over live targets (exp(-10 d) -
///   1) / 10 paper      10 dPoints - 2 dFirstContacts max(0, s) / 0.8 + sum over live targets
///   (exp(-10 d) - 1)
/// with s the strike speed of the latest contact, m/s, and d the distance from a target's origin to
/// the hammer's marker, m. "sparse" keeps the first term only. The user's effort is not the app's
/// matter.
class Env : public rl::RLEnv {
 public:
  Env(const Round& round, Privileged privileged)
      : round_(round), privileged_(std::move(privileged)) {}

  std::string_view typeName() const override { return "whacamole.Env"; }
  void beginRound() override;
  void declareLog() override;
  double calculateReward() override;
  bool isOver() const override;
  float timeFeature() const override;
  void fillPrivileged(std::span<float> values) const override { privileged_.fill(values); }
  void fields(Archive& archive) override;

 private:
  double contactReward() const;
  double distanceReward() const;

  const Round& round_;
  Privileged privileged_;
  int points_ = 0;
  int first_contacts_ = 0;
  // Of the present frame.
  double contact_ = 0.0;
  double distance_ = 0.0;
};

}  // namespace sim2vr::games::whacamole

#include "sim2vr/rl/game.hpp"

namespace sim2vr::rl {

void RLEnv::Start() {
  InitialiseGame();
  InitialiseReward();
  Reset();
}

void RLEnv::Update() {
  CalculateReward();
  UpdateIsFinished();
}

void RLEnv::fields(Archive& archive) {
  archive.field("reward", reward_);
  archive.field("finished", finished_);
  archive.field("log", log_);
}

}  // namespace sim2vr::rl

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

void RLEnv::fillPrivileged(std::span<float>) const {}

void RLEnv::fields(Archive& archive) {
  archive.field("reward", reward_);
  archive.field("finished", finished_);
  archive.field("log", log_);
}

std::optional<double> Game::headRequest(std::uint32_t) const { return std::nullopt; }

const std::vector<std::string>& Game::privilegedNames() const {
  static const std::vector<std::string> none;
  return none;
}

}  // namespace sim2vr::rl

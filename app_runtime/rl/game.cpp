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
  step_begins_ = false;
}

void RLEnv::beginStep(int frames) {
  frames_per_step_ = frames;
  step_begins_ = true;
}

void RLEnv::logTerm(const std::string& name, double value) {
  double& step = log_[name];
  step = step_begins_ ? value : step + value;
  log_[name + kSumSuffix] += value;
}

void RLEnv::fillPrivileged(std::span<float>) const {}

void RLEnv::fields(Archive& archive) {
  archive.field("reward", reward_);
  archive.field("finished", finished_);
  archive.field("log", log_);
}

std::optional<double> Game::headRequest(std::uint32_t) const { return std::nullopt; }

std::string Game::timelineJson(std::uint32_t) const { return ""; }

const std::vector<std::string>& Game::privilegedNames() const {
  static const std::vector<std::string> none;
  return none;
}

}  // namespace sim2vr::rl

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/rl/game.hpp"

#include <utility>

namespace sim2vr::rl {

void RLEnv::Start() { beginRound(); }

void RLEnv::Update() {
  reward_ = static_cast<float>(calculateReward());
  updateLog();
  finished_ = isOver();
  step_begins_ = false;
}

void RLEnv::beginStep(int frames) {
  frames_per_step_ = frames;
  step_begins_ = true;
}

void RLEnv::logColumn(const std::string& name, std::function<double()> value) {
  columns_.push_back({&log_[name], nullptr, std::move(value)});
}

void RLEnv::logTerm(const std::string& name, std::function<double()> value) {
  columns_.push_back({&log_[name], &log_[name + kSumSuffix], std::move(value)});
}

void RLEnv::updateLog() {
  if (columns_.empty()) declareLog();
  for (const Column& column : columns_) {
    const double value = column.now();
    const bool adds = column.sum != nullptr && !step_begins_;
    *column.value = adds ? *column.value + value : value;
    if (column.sum != nullptr) *column.sum += value;
  }
}

void RLEnv::fillPrivileged(std::span<float>) const {}

void RLEnv::fields(Archive& archive) {
  archive.field("reward", reward_);
  archive.field("finished", finished_);
  archive.field("log", log_);
  if (archive.loading()) columns_.clear();
}

std::optional<double> Game::headRequest(std::uint32_t) const { return std::nullopt; }

std::string Game::timelineJson(std::uint32_t) const { return ""; }

const std::vector<std::string>& Game::privilegedNames() const {
  static const std::vector<std::string> none;
  return none;
}

}  // namespace sim2vr::rl

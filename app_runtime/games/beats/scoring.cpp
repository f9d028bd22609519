// SPDX-License-Identifier: Apache-2.0
#include "beats/scoring.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "beats/directions.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr int kHighestTier = 3;
// Slower than this across the face is no direction.
constexpr double kStill_mps = 0.01;

}  // namespace

std::optional<double> cutAngle_deg(const Box& box, const Vec3& velocity_mps) {
  if (box.cut == CutDirection::kAny) return 0.0;
  const double x = velocity_mps.x(), y = velocity_mps.y();
  if (std::hypot(x, y) < kStill_mps) return std::nullopt;
  const Eigen::Vector2d wanted = cutVector(box);
  const double sine = wanted.x() * y - wanted.y() * x;
  const double cosine = wanted.x() * x + wanted.y() * y;
  return std::abs(std::atan2(sine, cosine)) * 180.0 / std::numbers::pi;
}

int cutPoints(const ScoreRules& rules, double speed_mps, double angle_deg) {
  const double speed_share = std::clamp(
      (speed_mps - rules.min_speed_mps) / (rules.full_speed_mps - rules.min_speed_mps), 0.0, 1.0);
  const double angle_share = std::clamp(1.0 - angle_deg / rules.angle_limit_deg, 0.0, 1.0);
  return static_cast<int>(
      std::lround(kLeastPoints + kSpeedPoints * speed_share + kAnglePoints * angle_share));
}

// 2 slices to the second tier, 4 more to the third, 8 more to the last.
void Multiplier::addSlice() {
  if (tier_ == kHighestTier) return;
  if (++slices_ < 2 << tier_) return;
  ++tier_;
  slices_ = 0;
}

void Multiplier::addFault() {
  tier_ = std::max(0, tier_ - 1);
  slices_ = 0;
}

void Multiplier::fields(Archive& archive) {
  archive.field("tier", tier_, {0.0, kHighestTier});
  archive.field("slices", slices_, kCounts);
}

}  // namespace sim2vr::games::beats

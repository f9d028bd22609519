// SPDX-License-Identifier: Apache-2.0
#include "beats/directions.hpp"

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <numbers>

namespace sim2vr::games::beats {

Eigen::Vector2d directionVector(CutDirection direction) {
  // In the order of CutDirection.
  constexpr double kHalf = std::numbers::sqrt2 / 2.0;
  constexpr std::array<std::array<double, 2>, 9> kVectors{{{0.0, 1.0},
                                                           {0.0, -1.0},
                                                           {-1.0, 0.0},
                                                           {1.0, 0.0},
                                                           {-kHalf, kHalf},
                                                           {kHalf, kHalf},
                                                           {-kHalf, -kHalf},
                                                           {kHalf, -kHalf},
                                                           {0.0, 0.0}}};
  const auto& vector = kVectors[static_cast<std::size_t>(direction)];
  return {vector[0], vector[1]};
}

Eigen::Vector2d cutVector(const Box& box) {
  const double angle_rad = box.angle_offset_deg * std::numbers::pi / 180.0;
  return Eigen::Rotation2Dd(angle_rad) * directionVector(box.cut);
}

CutDirection opposite(CutDirection direction) {
  using enum CutDirection;
  constexpr std::array kOpposites{kDown,     kUp,      kRight,  kLeft, kDownRight,
                                  kDownLeft, kUpRight, kUpLeft, kAny};
  return kOpposites[static_cast<std::size_t>(direction)];
}

}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
#include "pointing/effective.hpp"

#include <cmath>

namespace sim2vr::games::pointing {

Movement movementOf(const Vec3& from_m, const Vec3& to_m, const Vec3& began_m, const Vec3& ended_m,
                    double time_s) {
  const Vec3 axis = (to_m - from_m).normalized();
  return {time_s, (ended_m - to_m).dot(axis), (ended_m - began_m).dot(axis)};
}

double Effective::index_bits() const { return std::log2(distance_m / width_m() + 1.0); }

void MovementSums::add(const Movement& movement) {
  ++count_;
  time_sum_s_ += movement.time_s;
  length_sum_m_ += movement.length_m;
  offset_sum_m_ += movement.offset_m;
  offset_square_sum_m2_ += movement.offset_m * movement.offset_m;
}

std::optional<Effective> MovementSums::effective() const {
  constexpr double kLeastVariance_m2 = 1e-12;
  if (count_ < 2) return std::nullopt;
  const double variance_m2 =
      (offset_square_sum_m2_ - offset_sum_m_ * offset_sum_m_ / count_) / (count_ - 1);
  const double distance_m = length_sum_m_ / count_;
  if (variance_m2 < kLeastVariance_m2 || distance_m <= 0.0) return std::nullopt;
  return Effective{time_sum_s_ / count_, distance_m, std::sqrt(variance_m2)};
}

void MovementSums::fields(Archive& archive) {
  archive.field("count", count_, kCounts);
  archive.field("time_sum_s", time_sum_s_, kQuantities);
  archive.field("length_sum_m", length_sum_m_, kQuantities);
  archive.field("offset_sum_m", offset_sum_m_, kQuantities);
  archive.field("offset_square_sum_m2", offset_square_sum_m2_, kQuantities);
}

}  // namespace sim2vr::games::pointing

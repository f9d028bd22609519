// SPDX-License-Identifier: Apache-2.0
// What was really done in a block: effective distance, width, index and throughput of ISO 9241-411,
// as R. W. Soukoreff and I. S. MacKenzie compute them (International Journal of Human-Computer
// Studies 61 (2004) 751-789).
#pragma once

#include <optional>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/math.hpp"

namespace sim2vr::games::pointing {

/// One movement from a selection to the next, along the task axis: from the centre of the target
/// before to that of the target aimed at. Errors count as well.
struct Movement {
  double time_s = 0.0;
  /// Of the selection beyond the target's centre; negative: short of it.
  double offset_m = 0.0;
  /// From the selection before to this one.
  double length_m = 0.0;
};

/// `from` and `to`: centres of the two targets; `began` and `ended`: the two selections.
Movement movementOf(const Vec3& from_m, const Vec3& to_m, const Vec3& began_m, const Vec3& ended_m,
                    double time_s);

/// Of a block, or of several movements of it.
struct Effective {
  double movement_time_s = 0.0;
  double distance_m = 0.0;
  /// Of the offsets.
  double deviation_m = 0.0;

  /// 4.133 standard deviations: the width that would hold 96 % of normally spread selections.
  double width_m() const { return 4.133 * deviation_m; }
  double index_bits() const;
  double throughput_bps() const { return index_bits() / movement_time_s; }
};

class MovementSums {
 public:
  void add(const Movement& movement);
  int count() const { return count_; }
  /// None for fewer than two movements, and where selections do not spread (less than 1 um).
  std::optional<Effective> effective() const;
  void fields(Archive& archive);

 private:
  int count_ = 0;
  double time_sum_s_ = 0.0;
  double length_sum_m_ = 0.0;
  double offset_sum_m_ = 0.0;
  double offset_square_sum_m2_ = 0.0;
};

}  // namespace sim2vr::games::pointing

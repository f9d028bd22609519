// SPDX-License-Identifier: Apache-2.0
// The options of a round of pointing (docs/reference/games/pointing.md).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/math.hpp"
#include "sim2vr/core/options.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::games::pointing {

inline constexpr int kMostTargets = 25;
inline constexpr int kMostBlocks = 25;

struct Settings {
  /// Targets on the circle; odd, so that there is a next one opposite.
  int targets = 9;
  /// From the centre of a target to that of the next one in turn. Every distance comes with every
  /// width: a block each. These nine have nine indices of difficulty, from 1.7 to 4.1 bits.
  std::vector<double> distances_m{0.10, 0.18, 0.32};
  std::vector<double> widths_m{0.02, 0.03, 0.045};
  /// How often each block comes up in a round.
  int repeats = 1;

  /// Centre of the circle from the head at the start of the round, world axes; to the side of the
  /// hand that plays.
  double side_m = 0.15;
  double height_m = -0.10;
  double depth_m = 0.40;
  /// Ask the player to look at the centre.
  bool head_request = true;

  /// From the grip to the tip of the stylus.
  double stylus_m = 0.10;
  /// The tip must come so far out of the plane between two selections.
  double rearm_m = 0.0;
  float timeout_s = 3.0F;
  xr::Hand hand = xr::Hand::right;

  /// Hits and errors only.
  bool sparse = false;
  double error_cost = 5.0;

  Vec3 center_m() const { return {hand == xr::Hand::left ? -side_m : side_m, height_m, depth_m}; }

  /// Throws InvalidArgument naming the option.
  static Settings fromOptions(Options& options);

  /// A JSON object with the options that decide what happens in a round, as far as they are not
  /// the default.
  std::string playOptionsJson() const;
};

// Where the targets of a block are, which one is next, and how hard it is to reach.

/// A run of movements of one distance and width around the circle.
struct Block {
  double distance_m = 0.0;
  double width_m = 0.0;

  /// log2(D / W + 1), bits (ISO 9241-411; Shannon's form).
  double index_bits() const;
};

/// All blocks of a round in the order in which they are played, drawn with a generator of its own.
std::vector<Block> drawBlocks(const Settings& settings, std::uint32_t seed);

/// The number of the target that is up in trial `trial` of a block, 0 to `targets`: trial 0 begins
/// at target 0, each next target lies opposite, and the last trial ends at target 0.
int targetOfTrial(int trial, int targets);

/// Centre of a target from the circle's centre, in the plane (z = 0). Target 0 is at the top; they
/// are numbered clockwise as the player sees them. The circle is such that targets that follow each
/// other are the block's distance apart: its diameter is D / cos(pi / 2n), 1.5 % more for n = 9.
Vec3 targetCenter_m(int target, int targets, double distance_m);

// What was really done in a block: effective distance, width, index and throughput of ISO 9241-411,
// as R. W. Soukoreff and I. S. MacKenzie compute them (International Journal of Human-Computer
// Studies 61 (2004) 751-789).

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

// What a round counts and measures.

struct Tally {
  int hits = 0;
  int errors = 0;
  int timeouts = 0;
  /// Of all blocks. Their offsets are not looked at together: see `variance_sum_m2`.
  int movements = 0;
  double time_sum_s = 0.0;
  double index_sum_bits = 0.0;
  // Of the blocks that are over and have effective numbers.
  int blocks = 0;
  double throughput_sum_bps = 0.0;
  double effective_index_sum_bits = 0.0;
  double variance_sum_m2 = 0.0;

  void add(const Movement& movement, double index_bits);
  void add(const Effective& block);
  int failures() const { return errors + timeouts; }
  void fields(Archive& archive);
};

}  // namespace sim2vr::games::pointing

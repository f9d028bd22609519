// SPDX-License-Identifier: Apache-2.0
// What a round counts and measures.
#pragma once

#include "pointing/effective.hpp"

namespace sim2vr::games::pointing {

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

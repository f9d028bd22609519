// SPDX-License-Identifier: Apache-2.0
#include "pointing/tally.hpp"

namespace sim2vr::games::pointing {

void Tally::add(const Movement& movement, double index_bits) {
  ++movements;
  time_sum_s += movement.time_s;
  index_sum_bits += index_bits;
}

void Tally::add(const Effective& block) {
  ++blocks;
  throughput_sum_bps += block.throughput_bps();
  effective_index_sum_bits += block.index_bits();
  variance_sum_m2 += block.deviation_m * block.deviation_m;
}

void Tally::fields(Archive& archive) {
  archive.field("hits", hits, kCounts);
  archive.field("errors", errors, kCounts);
  archive.field("timeouts", timeouts, kCounts);
  archive.field("movements", movements, kCounts);
  archive.field("time_sum_s", time_sum_s, kQuantities);
  archive.field("index_sum_bits", index_sum_bits, kQuantities);
  archive.field("blocks", blocks, kCounts);
  archive.field("throughput_sum_bps", throughput_sum_bps, kQuantities);
  archive.field("effective_index_sum_bits", effective_index_sum_bits, kQuantities);
  archive.field("variance_sum_m2", variance_sum_m2, kQuantities);
}

}  // namespace sim2vr::games::pointing

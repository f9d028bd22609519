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
  archive.field("hits", hits);
  archive.field("errors", errors);
  archive.field("timeouts", timeouts);
  archive.field("movements", movements);
  archive.field("time_sum_s", time_sum_s);
  archive.field("index_sum_bits", index_sum_bits);
  archive.field("blocks", blocks);
  archive.field("throughput_sum_bps", throughput_sum_bps);
  archive.field("effective_index_sum_bits", effective_index_sum_bits);
  archive.field("variance_sum_m2", variance_sum_m2);
}

}  // namespace sim2vr::games::pointing

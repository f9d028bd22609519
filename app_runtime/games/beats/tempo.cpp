// SPDX-License-Identifier: Apache-2.0
#include "beats/tempo.hpp"

#include <algorithm>

namespace sim2vr::games::beats {

TempoMap::TempoMap(double beats_per_minute, const std::vector<Change>& changes)
    : pieces_{{0.0, 0.0, 60.0 / beats_per_minute}} {
  for (const Change& change : changes) {
    const double time_s = raw(change.beat);
    if (change.beat <= pieces_.back().beat) pieces_.pop_back();
    pieces_.push_back({change.beat, time_s, 60.0 / change.beats_per_minute});
  }
}

TempoMap::TempoMap(const std::vector<Region>& regions) {
  for (const Region& region : regions) {
    const double beats = region.end_beat - region.start_beat;
    pieces_.push_back({region.start_beat, region.start_s, (region.end_s - region.start_s) / beats});
  }
}

double TempoMap::raw(double beat) const {
  const Piece& found = piece(beat);
  return found.time_s + (beat - found.beat) * found.beat_s;
}

const TempoMap::Piece& TempoMap::piece(double beat) const {
  const auto behind = std::upper_bound(
      pieces_.begin(), pieces_.end(), beat,
      [](double wanted, const Piece& candidate) { return wanted < candidate.beat; });
  return behind == pieces_.begin() ? pieces_.front() : *(behind - 1);
}

}  // namespace sim2vr::games::beats

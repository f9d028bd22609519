// SPDX-License-Identifier: Apache-2.0
// Between beats and seconds.
#pragma once

#include <vector>

namespace sim2vr::games::beats {

/// Tempo as a chain of straight pieces: each begins at a beat and a time and has a length of a
/// beat.
class TempoMap {
 public:
  /// From `beat` on; a change says how fast beats follow.
  struct Change {
    double beat = 0.0;
    double beats_per_minute = 120.0;
  };
  /// A stretch of music with its own first and last beat and sample, as audio files of v4 have
  /// them.
  struct Region {
    double start_beat = 0.0;
    double end_beat = 0.0;
    double start_s = 0.0;
    double end_s = 0.0;
  };
  struct Piece {
    double beat = 0.0;
    double time_s = 0.0;
    double beat_s = 0.5;
  };

  /// A constant tempo up to the first change; changes in order of their beats, equal ones: the last
  /// counts.
  TempoMap(double beats_per_minute, const std::vector<Change>& changes);
  /// Regions in order, each beginning where the last one ends; before the first and behind the last
  /// the nearest one's tempo goes on.
  explicit TempoMap(const std::vector<Region>& regions);

  /// Time of a beat, s after beat 0.
  double seconds(double beat) const { return raw(beat) - raw(0.0); }
  double beatsPerMinuteAt(double beat) const { return 60.0 / piece(beat).beat_s; }
  const std::vector<Piece>& pieces() const { return pieces_; }

 private:
  double raw(double beat) const;
  const Piece& piece(double beat) const;

  std::vector<Piece> pieces_;
};

}  // namespace sim2vr::games::beats

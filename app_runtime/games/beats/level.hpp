// SPDX-License-Identifier: Apache-2.0
// What is played: boxes, mines and walls of one level with their times, wherever it came from.
//
// The grid is Beat Saber's: 4 columns from left (0) to right (3), 3 rows from bottom (0) to top
// (2). Places may lie between or beyond the cells (mapping extensions, generated levels), hence
// doubles. Beats have become seconds when a level is made (changes of tempo included); times count
// from the level's first beat.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace sim2vr::games::beats {

enum class Hand : std::uint8_t { kLeft, kRight };

/// In which direction a blade has to go through a box; in the order of Beat Saber's numbers.
enum class CutDirection : std::uint8_t {
  kUp,
  kDown,
  kLeft,
  kRight,
  kUpLeft,
  kUpRight,
  kDownLeft,
  kDownRight,
  kAny
};

/// A box to cut.
struct Box {
  double time_s = 0.0;
  double column = 0.0;
  double row = 0.0;
  Hand hand = Hand::kRight;
  CutDirection cut = CutDirection::kAny;
  /// Added to the cut direction, counter-clockwise as the player sees it.
  double angle_offset_deg = 0.0;
  /// A link of a chain: lies between the cells, close behind the chain's head or another link, so
  /// that the head's stroke goes through it; to be cut in any direction.
  bool link = false;
};

/// Not to be touched by a blade.
struct Mine {
  double time_s = 0.0;
  double column = 0.0;
  double row = 0.0;
};

/// Not to be touched by the head. It covers `width` cells from the left edge of cell `column` and
/// `height` cells from the lower edge of cell `row` on.
struct Wall {
  double time_s = 0.0;
  double duration_s = 0.0;
  double column = 0.0;
  double row = 0.0;
  double width = 1.0;
  double height = 3.0;
};

/// From here on beats follow each other at another rate.
struct TempoChange {
  double time_s = 0.0;
  double beats_per_minute = 120.0;
};

/// All lists are in order of time; equal times keep the order of the source.
struct Level {
  std::string name;
  /// Where play ends.
  double length_s = 0.0;
  /// At the level's start; for the display of beats, not for times.
  double beats_per_minute = 120.0;
  /// Of the beats behind the start; for their display, too.
  std::vector<TempoChange> tempo_changes;
  /// Speed of approach ("note jump speed").
  double speed_mps = 10.0;
  /// From appearing to reaching the player ("half jump duration" in seconds).
  double approach_s = 1.0;
  std::vector<Box> boxes;
  std::vector<Mine> mines;
  std::vector<Wall> walls;
  /// Of the bytes that the level was made of, as hexadecimal digits: part of the state, so that a
  /// saved round is not continued in another level.
  std::string hash;
};

}  // namespace sim2vr::games::beats

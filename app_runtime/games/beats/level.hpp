// SPDX-License-Identifier: Apache-2.0
// What is played: boxes, mines and walls of one level with their times, wherever it came from.
//
// The grid is Beat Saber's: 4 columns from left (0) to right (3), 3 rows from bottom (0) to top
// (2). Places may lie between or beyond the cells (mapping extensions, generated levels), hence
// doubles. Beats have become seconds when a level is made (changes of tempo included); times count
// from the level's first beat.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/core/math.hpp"

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

// Between beats and seconds.

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

// Cut directions as vectors and back.

/// Unit vector of a blade's motion as the player sees it, right and up; zero for kAny.
Eigen::Vector2d directionVector(CutDirection direction);

/// The same of a box, its angle offset included.
Eigen::Vector2d cutVector(const Box& box);

/// The direction back; kAny stays.
CutDirection opposite(CutDirection direction);

// Where things are: from the level's cells and seconds to metres relative to the round's origin.

/// Sizes and places; the defaults let a body whose trunk does not move cut every cell with either
/// hand (docs/reference/games/beats.md). The origin is the head's position in the round's
/// first frame, axes are the world's.
struct Layout {
  double cell_width_m = 0.40;
  double cell_height_m = 0.35;
  /// y of the middle row.
  double middle_row_m = -0.30;
  /// y of the three rows, where they are not evenly spaced; instead of the two numbers above.
  std::optional<std::array<double, 3>> rows_m;
  /// z at which boxes and mines are at their time.
  double cut_distance_m = 0.80;
  double box_edge_m = 0.35;
  /// Width, height (along the cut) and depth of what a correct cut has to touch of a box; nothing:
  /// the box itself.
  std::optional<Vec3> hit_box_m;
  /// How much nearer to the player its middle is than the box's.
  double hit_box_nearer_m = 0.0;
  /// Of a link of a chain.
  double link_edge_m = 0.175;
  double mine_radius_m = 0.12;
  double head_radius_m = 0.08;
  /// From the grip to the blade.
  double blade_start_m = 0.08;
  double blade_length_m = 1.0;
};

/// A cuboid that rods are tested against; a point where half_m is 0.
struct Block {
  Vec3 center_m = Vec3::Zero();
  Vec3 half_m = Vec3::Zero();
  /// About z, counter-clockwise as the player sees it.
  double turn_rad = 0.0;
};

inline constexpr double kShallowestWall_m = 0.05;
/// Behind the head plane by this much a wall's back is when it is gone.
inline constexpr double kWallGone_m = 0.5;

/// y of a row's middle; rows may be fractions and may lie outside the grid.
double rowHeight_m(const Layout& layout, double row);

/// How far a box is turned about z: at 0 its mark points down.
double boxTurn_rad(const Box& box);

/// Positions at level time `time_s`. Of a mine the middle alone: it is what lies within its radius.
Block boxAt(const Layout& layout, const Level& level, const Box& box, double time_s);
Block mineAt(const Layout& layout, const Level& level, const Mine& mine, double time_s);
Block wallAt(const Layout& layout, const Level& level, const Wall& wall, double time_s);

/// When a box or mine of that time is in the head plane.
double passTime_s(const Layout& layout, const Level& level, double time_s);
/// When a wall is gone.
double goneTime_s(const Level& level, const Wall& wall);

// What distinguishes levels.

/// 64-bit FNV-1a, 16 hexadecimal digits: of the bytes that a level was read from.
std::string bytesHash(std::string_view bytes);

/// The same of everything that a level holds but its hash: for levels that are made, not read.
std::string contentHash(Level level);

// What can be said of a level without playing it.

struct LevelFacts {
  std::size_t boxes = 0;
  std::size_t links = 0;
  std::size_t mines = 0;
  std::size_t walls = 0;
  double seconds = 0.0;
  /// Boxes per second from the first to the last one, and in the fullest second.
  double boxes_per_s = 0.0;
  double peak_boxes_per_s = 0.0;
  /// Boxes that ask a hand to go on in the direction in which it has just cut: the blade has to be
  /// brought back first.
  std::vector<std::size_t> parity_problems;
};

/// A hand with more time than this brings its blade back at leisure.
inline constexpr double kBringBack_s = 1.0;
/// Boxes of a hand that are so close to each other are one stroke.
inline constexpr double kOneStroke_s = 0.1;

LevelFacts levelFacts(const Level& level);

// A level as a picture over time, in the words that the harness draws any game's timeline with.

/// A JSON object as rl::Game::timelineJson says: the cells of the grid are its lanes, row by row
/// from the bottom. Its `level` has what Level has; hands are 0 (left) and 1 (right), cuts 0 to 8.
std::string timelineJson(const Level& level);

}  // namespace sim2vr::games::beats

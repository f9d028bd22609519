// SPDX-License-Identifier: Apache-2.0
#include "beats/level_generator.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "sim2vr/core/random.hpp"

namespace sim2vr::games::beats {
namespace {

/// From one wall's end to the next one's start.
constexpr double kStandUp_s = 2.0;
constexpr double kLongestWall_s = 0.9;
/// The player is out of the way so long before and after a wall.
constexpr double kBefore_s = 0.4;
constexpr double kAfter_s = 0.25;
/// Starts lie on tenths of a second.
constexpr double kStep_s = 0.1;

Wall shape(int kind) {
  switch (kind) {
    case 0:
      return {.column = 0.0, .row = 0.0, .width = 2.0, .height = 5.0};
    case 1:
      return {.column = 2.0, .row = 0.0, .width = 2.0, .height = 5.0};
    default:
      return {.column = 0.0, .row = 2.0, .width = 4.0, .height = 3.0};
  }
}

/// Walls between two times, evenly spread with chance in it: the left or the right half of the
/// lane, or the upper part of its whole width. Between two is time to stand up again.
std::vector<Wall> placeWalls(double per_minute, double from_s, double to_s, Random& random) {
  std::vector<Wall> walls;
  const double span_s = to_s - from_s;
  const int most = static_cast<int>(span_s / (kStandUp_s + kLongestWall_s));
  const int count = std::min(static_cast<int>(per_minute * span_s / 60.0 + 0.5), most);
  for (int i = 0; i < count; ++i) {
    const double window_s = span_s / count;
    Wall wall = shape(random.range(0, 3));
    wall.duration_s = kLongestWall_s * random.range(1, 4) / 3.0;
    const double room_s = window_s - kStandUp_s - wall.duration_s;
    const int steps = static_cast<int>(room_s / kStep_s);
    wall.time_s = from_s + i * window_s + kStep_s * random.range(0, steps + 1);
    walls.push_back(wall);
  }
  return walls;
}

/// Whether a box of that time and cell would be in a wall, or so close before or behind one that
/// the player, who is dodging it, does not reach it well.
bool isBehindWall(const std::vector<Wall>& walls, double time_s, double column, double row) {
  return std::any_of(walls.begin(), walls.end(), [&](const Wall& wall) {
    const bool meanwhile =
        time_s > wall.time_s - kBefore_s && time_s < wall.time_s + wall.duration_s + kAfter_s;
    return meanwhile && column > wall.column - 1.0 && column < wall.column + wall.width &&
           row > wall.row - 1.0 && row < wall.row + wall.height;
  });
}

constexpr double kBeatsPerMinute = 100.0;
constexpr double kFirst_s = 2.0;
/// Nothing comes in the last second.
constexpr double kQuietEnd_s = 1.0;
/// Between two boxes of one hand at least; of a song.
constexpr double kHandGap_s = 0.55;
constexpr double kSongHandGap_s = 0.38;
/// Boxes appear so far away, unless that is sooner or later than kSoonest_s and kLatest_s.
constexpr double kSight_m = 14.0;
constexpr double kSoonest_s = 1.0;
constexpr double kLatest_s = 3.0;
/// Half the time of a stroke, and the blade's reach along the lane to both sides of the cut plane.
constexpr double kHalfStroke_s = 0.15;
constexpr double kReach_m = 0.9;

struct HandState {
  Hand hand;
  double last_s = -10.0;
  /// Where the next stroke begins: behind the last one's end.
  CutDirection last = CutDirection::kUp;
  int column = 0;
  int row = 1;
};

class Composer {
 public:
  Composer(const GeneratorSettings& settings, std::uint32_t seed)
      : settings_(settings), random_(seed) {
    level_.name = "generated " + std::to_string(seed);
    level_.length_s = settings.seconds;
    level_.beats_per_minute = song_ ? random_.range(8, 16) * 10.0 : kBeatsPerMinute;
    slot_s_ = 30.0 / level_.beats_per_minute;
    level_.speed_mps = settings.speed_mps;
    if (settings.speed_spread_mps > 0.0) {
      level_.speed_mps += settings.speed_spread_mps * random_.range(-8, 9) / 8.0;
    }
    level_.approach_s = std::clamp(kSight_m / level_.speed_mps, kSoonest_s, kLatest_s);
  }

  Level compose() {
    level_.walls =
        placeWalls(settings_.walls_per_minute, kFirst_s, settings_.seconds - kQuietEnd_s, random_);
    const int slots = slotBefore(settings_.seconds - kQuietEnd_s);
    double due = 0.0;
    for (int slot = firstSlot(); slot <= slots; ++slot) {
      due = std::min(due + settings_.boxes_per_second * slot_s_, kMostDue);
      const double patience = 0.25 * random_.range(0, 4);
      if (due < 1.0 + patience * kPlay) continue;
      due -= static_cast<double>(addBoxes(slot * slot_s_));
    }
    addMines();
    level_.hash = contentHash(level_);
    return std::move(level_);
  }

 private:
  /// Boxes that are put off because a wall is in the way are not all made up for.
  static constexpr double kMostDue = 2.0;
  /// How far boxes stray from their even spacing.
  static constexpr double kPlay = 0.8;

  int firstSlot() const { return static_cast<int>(std::ceil(kFirst_s / slot_s_)); }
  int slotBefore(double time_s) const { return static_cast<int>(std::floor(time_s / slot_s_)); }

  /// Returns how many there are.
  std::size_t addBoxes(double time_s) {
    const std::size_t before = level_.boxes.size();
    const bool together = settings_.pattern == "together" ||
                          (settings_.pattern == "mixed" && random_.range(0, 5) == 0) ||
                          (song_ && random_.range(0, 3) == 0);
    if (together && isFree(left_, time_s) && isFree(right_, time_s)) {
      addBox(left_, time_s, true);
      addBox(right_, time_s, true);
      return level_.boxes.size() - before;
    }
    const bool again = (song_ || settings_.pattern == "mixed") && random_.range(0, 5) == 0;
    HandState& next = (last_ == Hand::kLeft) == again ? left_ : right_;
    HandState& other = &next == &left_ ? right_ : left_;
    for (HandState* hand : {&next, &other}) {
      if (!isFree(*hand, time_s)) continue;
      addBox(*hand, time_s, false);
      break;
    }
    return level_.boxes.size() - before;
  }

  bool isFree(const HandState& hand, double time_s) const {
    if (time_s - hand.last_s < (song_ ? kSongHandGap_s : kHandGap_s)) return false;
    const double inner = hand.hand == Hand::kLeft ? 1.0 : 2.0;
    // The lowest row is free wherever any is.
    return !isBehindWall(level_.walls, time_s, inner, 0.0);
  }

  void addBox(HandState& hand, double time_s, bool together) {
    Box box;
    box.time_s = time_s;
    box.hand = hand.hand;
    box.cut = song_ ? chooseSongCut(hand) : chooseCut(hand, together);
    if (song_) {
      chooseSongPlace(hand, time_s, together);
    } else {
      choosePlace(hand, time_s);
    }
    box.column = hand.column;
    box.row = hand.row;
    hand.last = box.cut;
    hand.last_s = time_s;
    if (settings_.pattern == "any" || (song_ && random_.range(0, 20) == 0)) {
      box.cut = CutDirection::kAny;
    }
    last_ = hand.hand;
    level_.boxes.push_back(box);
  }

  /// Back the way the blade came, or 45 degrees beside that; never level, and not towards the other
  /// hand's box at the same time.
  CutDirection chooseCut(const HandState& hand, bool together) {
    using enum CutDirection;
    const Eigen::Vector2d back = -directionVector(hand.last);
    std::array<CutDirection, 3> candidates{kDown, kDownLeft, kDownRight};
    if (back.y() > 0.0) candidates = {kUp, kUpLeft, kUpRight};
    std::vector<CutDirection> fitting;
    for (const CutDirection candidate : candidates) {
      const Eigen::Vector2d cut = directionVector(candidate);
      const bool inwards = (cut.x() > 0.0) == (hand.hand == Hand::kLeft) && cut.x() != 0.0;
      if (cut.dot(back) > 0.1 && !(together && inwards)) fitting.push_back(candidate);
    }
    return fitting[static_cast<std::size_t>(random_.range(0, static_cast<int>(fitting.size())))];
  }

  /// Back the way the blade came, or 45 degrees beside that: most often up and down, seldom level.
  CutDirection chooseSongCut(const HandState& hand) {
    using enum CutDirection;
    constexpr std::array kWeighted{kUp,       kUp,        kUp,       kUp,        kDown,   kDown,
                                   kDown,     kDown,      kUpLeft,   kUpRight,   kUpLeft, kUpRight,
                                   kDownLeft, kDownRight, kDownLeft, kDownRight, kLeft,   kRight};
    const Eigen::Vector2d back = -directionVector(hand.last);
    std::vector<CutDirection> fitting;
    for (const CutDirection candidate : kWeighted) {
      if (directionVector(candidate).dot(back) > 0.5) fitting.push_back(candidate);
    }
    return fitting[static_cast<std::size_t>(random_.range(0, static_cast<int>(fitting.size())))];
  }

  /// Low more often than high, on the hand's own side but for one in six that comes alone.
  void chooseSongPlace(HandState& hand, double time_s, bool together) {
    constexpr std::array kSongRows{0, 0, 0, 0, 0, 1, 1, 1, 2, 2};
    const bool crossed = random_.range(0, 6) == 0 && !together;
    const bool left = (hand.hand == Hand::kLeft) != crossed;
    const bool outer = random_.range(0, 3) == 0 && !crossed;
    hand.column = left ? (outer ? 0 : 1) : (outer ? 3 : 2);
    hand.row =
        kSongRows[static_cast<std::size_t>(random_.range(0, static_cast<int>(kSongRows.size())))];
    while (hand.row > 0 && isBehindWall(level_.walls, time_s, hand.column, hand.row)) --hand.row;
    if (isBehindWall(level_.walls, time_s, hand.column, hand.row)) {
      hand.column = hand.hand == Hand::kLeft ? 1 : 2;
    }
  }

  /// A cell on the hand's side, no further than one from the last one in each direction.
  void choosePlace(HandState& hand, double time_s) {
    const int inner = hand.hand == Hand::kLeft ? 1 : 2;
    const int outer = hand.hand == Hand::kLeft ? 0 : 3;
    hand.column = random_.range(0, 3) == 0 ? outer : inner;
    const int row = std::clamp(hand.row + random_.range(-1, 2), 0, 2);
    hand.row = row;
    while (hand.row > 0 && isBehindWall(level_.walls, time_s, hand.column, hand.row)) --hand.row;
  }

  void addMines() {
    const auto wanted =
        static_cast<int>(settings_.mines_per_minute * settings_.seconds / 60.0 + 0.5);
    constexpr int kTries = 12;
    for (int i = 0; i < wanted; ++i) {
      for (int tries = 0; tries < kTries; ++tries) {
        const int slot =
            random_.range(firstSlot(), slotBefore(settings_.seconds - kQuietEnd_s) + 1);
        Mine mine{slot * slot_s_, 0.0, 0.0};
        mine.column = random_.range(0, 4);
        mine.row = random_.range(0, 3);
        if (!isHarmless(mine)) continue;
        level_.mines.push_back(mine);
        break;
      }
    }
    std::stable_sort(level_.mines.begin(), level_.mines.end(),
                     [](const Mine& a, const Mine& b) { return a.time_s < b.time_s; });
  }

  /// Whether every box can be cut without touching the mine, and it can be seen.
  bool isHarmless(const Mine& mine) const {
    const double near_s = kHalfStroke_s + kReach_m / level_.speed_mps;
    for (const Box& box : level_.boxes) {
      if (std::abs(box.time_s - mine.time_s) < near_s && isInTheWay(mine, box)) return false;
    }
    for (const Mine& other : level_.mines) {
      if (other.time_s == mine.time_s && other.column == mine.column) return false;
    }
    return !isBehindWall(level_.walls, mine.time_s, mine.column, mine.row);
  }

  /// Same or next column, which the blade covers on its way to the box, or on the stroke's line.
  static bool isInTheWay(const Mine& mine, const Box& box) {
    const Eigen::Vector2d apart(mine.column - box.column, mine.row - box.row);
    if (std::abs(apart.x()) < 1.5) return true;
    const Eigen::Vector2d cut = cutVector(box);
    const double beside = std::abs(cut.x() * apart.y() - cut.y() * apart.x());
    return !cut.isZero() && beside < 0.75;
  }

  const GeneratorSettings& settings_;
  const bool song_ = settings_.pattern == "song";
  Random random_;
  /// Boxes and mines come on half beats.
  double slot_s_ = 0.0;
  Level level_;
  HandState left_{.hand = Hand::kLeft, .column = 1};
  HandState right_{.hand = Hand::kRight, .column = 2};
  Hand last_ = Hand::kRight;
};

}  // namespace

std::span<const std::string> generatorPatterns() {
  static const std::array<std::string, 5> kPatterns{"mixed", "alternating", "together", "any",
                                                    "song"};
  return kPatterns;
}

Level generateLevel(const GeneratorSettings& settings, std::uint32_t seed) {
  return Composer(settings, seed).compose();
}

}  // namespace sim2vr::games::beats

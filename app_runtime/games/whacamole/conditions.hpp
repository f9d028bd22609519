// SPDX-License-Identifier: Apache-2.0
// What a round of Whac-A-Mole is like: the conditions of the user study and the game's options.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/core/math.hpp"
#include "sim2vr/core/options.hpp"
#include "sim2vr/rl/game_facts.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::games::whacamole {

enum class Placement { kLow, kMid, kHigh };

struct Condition {
  std::string name;
  Placement placement = Placement::kMid;
  int max_targets = 3;
  /// A hit needs speed through the plane; otherwise every touch of a live target is a hit.
  bool constrained = true;
};

/// Where the target area is put, relative to the head at the start of the round.
struct PlacementGeometry {
  Vec3 offset_m;          // area origin minus head position, world axes; head rotation is ignored
  Quat rotation;          // of the area, world
  double head_pitch_deg;  // how the head is best held, up positive
  bool struck_down;       // whether a hit needs downward speed; otherwise forward speed
};

/// Where a designer puts the area; what is not given stays as the placement has it.
struct AreaChanges {
  std::optional<double> height_m = std::nullopt;    // above the head, of the area's middle
  std::optional<double> distance_m = std::nullopt;  // in front of the head
  std::optional<double> tilt_deg = std::nullopt;    // about x: 90 lies flat and faces up, 0 stands

  bool operator==(const AreaChanges&) const = default;
};

/// For a left-handed player the area lies on the other side of the head. A moved area asks for a
/// head between those of the three placements, by the direction in which its middle lies; one that
/// lies rather than stands, by a limit half-way between low and mid, is struck down.
PlacementGeometry geometry(Placement placement, xr::Hand hand = xr::Hand::right,
                           const AreaChanges& changes = {});

/// Component of the hammer's velocity that a constrained hit is judged by, m/s: downward speed for
/// an area like the low one, forward speed for the others.
double strikeSpeed(const PlacementGeometry& place, const Vec3& velocity_mps);
/// The study's; what a hit needs by default.
inline constexpr float kStrikeThreshold_mps = 0.8F;
/// Of the 3x3 grid, numbered row by row from the top left as the player sees them.
inline constexpr int kCells = 9;

/// Every name that the option "condition" takes: the conditions and the random mixes.
std::span<const std::string> conditionNames();

/// The same, as the game publishes them.
std::vector<rl::GameCondition> publishedConditions();

/// The condition of one round. A mix draws one of its members uniformly with a generator of its
/// own, so that `seed` alone fixes the round's spawns and can be compared with a recording's.
Condition resolveCondition(std::string_view name, std::uint32_t seed);

/// Which point's velocity is the hammer's.
enum class VelocityPoint {
  kRoot,  // the pivot near the hand
  kHead,  // the centre of the hit box
};

enum class RewardKind {
  kReference,  // as the reference implementation computes it
  kPaper,      // as its paper describes it
};

/// Chance weight per cell; empty when all cells are equal.
using CellWeights = std::vector<float>;

/// A target that shall appear: in the first frame with a game time of `time_s` or more.
struct ScheduledSpawn {
  float time_s = 0.0F;
  int cell = 0;
};

struct Settings {
  std::string condition = "medium";
  bool adaptive = false;
  bool sparse = false;
  RewardKind reward = RewardKind::kReference;
  float round_s = 60.0F;
  float countdown_s = 0.0F;
  /// Ask the player before a round to hold the head as suits the placement.
  bool head_request = true;
  bool show_controllers = true;
  /// Which controller holds the hammer; left: everything is the mirror image.
  xr::Hand hand = xr::Hand::right;
  AreaChanges area;
  /// From the centres of the cells on one side of the area to those on the other.
  double area_size_m = 0.25;
  double target_radius_m = 0.025;
  /// In order of time. When there are any, they replace the random spawns of the round.
  std::vector<ScheduledSpawn> spawns;
  /// Chance of each cell, up to a factor; empty when all are equal. Wins over `adaptive`.
  CellWeights spawn_weights;

  // How the hammer and the targets work; the defaults are the user study's.
  float fade_in_s = 0.1F;
  float life_s = 1.0F;
  /// Strike speed that a constrained hit must exceed.
  float strike_threshold_mps = kStrikeThreshold_mps;
  /// Share of a frame's raw velocity in the smoothed one; 1 is no smoothing.
  double velocity_smoothing = 0.5;
  VelocityPoint velocity_point = VelocityPoint::kRoot;
  /// Added to every side of the hammer's hit box.
  double hammer_margin_m = 0.0;

  /// Throws InvalidArgument naming the option.
  static Settings fromOptions(Options& options);

  /// A JSON object with the options that decide what happens in a round, other than the condition
  /// and as far as they are not the default: what a log needs so that it can be replayed.
  std::string playOptionsJson() const;
};

}  // namespace sim2vr::games::whacamole

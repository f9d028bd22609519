// SPDX-License-Identifier: Apache-2.0
#include "whacamole/conditions.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <utility>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/random.hpp"

namespace sim2vr::games::whacamole {
namespace {

struct ConditionRow {
  std::string_view name;
  Placement placement;
  int max_targets;
  std::string_view same_as = {};
};

constexpr std::array<ConditionRow, 11> kConditions{{
    {"easy", Placement::kMid, 1},
    {"medium", Placement::kMid, 3},
    {"mid", Placement::kMid, 3, "medium"},
    {"mid-medium", Placement::kMid, 3, "medium"},
    {"hard", Placement::kMid, 5},
    {"low", Placement::kLow, 3, "low-medium"},
    {"low-medium", Placement::kLow, 3},
    {"low-easy", Placement::kLow, 1},
    {"high", Placement::kHigh, 3, "high-medium"},
    {"high-medium", Placement::kHigh, 3},
    {"high-easy", Placement::kHigh, 1},
}};

struct MixRow {
  std::string_view name;
  std::vector<std::string_view> members;
};

const std::array<MixRow, 3>& mixes() {
  static const std::array<MixRow, 3> rows{{
      {"random", {"low-medium", "medium", "high-medium"}},
      {"random-easy", {"low-easy", "easy", "high-easy"}},
      {"random-easy-medium",
       {"low-easy", "easy", "high-easy", "low-medium", "medium", "high-medium"}},
  }};
  return rows;
}

constexpr std::string_view kUnconstrained = "-unconstrained";
constexpr std::uint32_t kMixSeedMask = 0x9E3779B9U;

const ConditionRow* findCondition(std::string_view name) {
  const auto found = std::find_if(kConditions.begin(), kConditions.end(),
                                  [name](const ConditionRow& row) { return row.name == name; });
  return found == kConditions.end() ? nullptr : &*found;
}

const MixRow* findMix(std::string_view name) {
  const auto found = std::find_if(mixes().begin(), mixes().end(),
                                  [name](const MixRow& row) { return row.name == name; });
  return found == mixes().end() ? nullptr : &*found;
}

std::string_view drawMember(const MixRow& mix, std::uint32_t seed) {
  Random random(seed ^ kMixSeedMask);
  // The first words of neighbouring seeds resemble each other.
  for (int i = 0; i < 8; ++i) random.next();
  return mix
      .members[static_cast<std::size_t>(random.range(0, static_cast<int>(mix.members.size())))];
}

std::string_view areaName(Placement placement) {
  switch (placement) {
    case Placement::kLow:
      return "Low";
    case Placement::kHigh:
      return "High";
    case Placement::kMid:
      break;
  }
  return "Middle";
}

std::string description(const ConditionRow& row) {
  const std::string targets =
      row.max_targets == 1 ? "1 target" : "up to " + std::to_string(row.max_targets) + " targets";
  return std::string(areaName(row.placement)) + " area, " + targets + " at once";
}

std::string description(const MixRow& mix) {
  std::string text;
  for (const std::string_view member : mix.members) {
    text += (text.empty() ? "Drawn for each round from " : ", ") + std::string(member);
  }
  return text;
}

std::vector<ScheduledSpawn> spawnsFromOptions(Options& options) {
  const std::vector<double> times = options.getNumbers("spawn_times", 0.0, 1e9);
  const std::vector<double> cells = options.getNumbers("spawn_cells", 0.0, kCells - 1);
  if (cells.size() != times.size()) {
    throw InvalidArgument("option 'spawn_cells'", std::to_string(cells.size()) + " cells",
                          std::to_string(times.size()) + ", one for each of spawn_times");
  }
  if (!std::is_sorted(times.begin(), times.end())) {
    throw InvalidArgument("option 'spawn_times'", "times out of order", "ascending times");
  }
  std::vector<ScheduledSpawn> spawns;
  for (std::size_t i = 0; i < times.size(); ++i) {
    const int cell = static_cast<int>(cells[i]);
    if (cell != cells[i]) {
      throw InvalidArgument("option 'spawn_cells'", std::to_string(cells[i]), "whole numbers");
    }
    spawns.push_back({static_cast<float>(times[i]), cell});
  }
  return spawns;
}

CellWeights weightsFromOptions(Options& options) {
  const std::vector<double> weights = options.getNumbers("spawn_weights", 1e-6, 1e6);
  if (!weights.empty() && weights.size() != kCells) {
    throw InvalidArgument("option 'spawn_weights'", std::to_string(weights.size()) + " numbers",
                          std::to_string(kCells) + ", one for each cell");
  }
  return {weights.begin(), weights.end()};
}

Quat aboutX(double x, double w) { return Quat(w, x, 0.0, 0.0).normalized(); }

constexpr double kRadPerDeg = std::numbers::pi / 180.0;
constexpr double kLies_deg = 22.5;

PlacementGeometry placementGeometry(Placement placement, double side_m) {
  switch (placement) {
    case Placement::kLow:
      return {{side_m, -0.30, 0.35}, aboutX(0.3826834, 0.9238795), -30.0, true};
    case Placement::kHigh:
      return {{side_m, 0.20, 0.30}, aboutX(-0.3826834, 0.9238795), 30.0, false};
    case Placement::kMid:
      break;
  }
  return {{side_m, -0.10, 0.40}, Quat::Identity(), -10.0, false};
}

double elevation_rad(const PlacementGeometry& place) {
  return std::atan2(place.offset_m.y(), place.offset_m.z());
}

/// Between the pitches of the three placements; beyond low and high as theirs.
double headPitch_deg(double direction_rad) {
  const std::array<PlacementGeometry, 3> known{placementGeometry(Placement::kLow, 0.0),
                                               placementGeometry(Placement::kMid, 0.0),
                                               placementGeometry(Placement::kHigh, 0.0)};
  for (std::size_t i = 1; i < known.size(); ++i) {
    const double from = elevation_rad(known[i - 1]);
    const double to = elevation_rad(known[i]);
    if (direction_rad > to) continue;
    const double share = std::max(0.0, (direction_rad - from) / (to - from));
    return std::lerp(known[i - 1].head_pitch_deg, known[i].head_pitch_deg, share);
  }
  return known.back().head_pitch_deg;
}

AreaChanges areaFromOptions(Options& options) {
  const auto number = [&options](const std::string& name, double least, double most) {
    // Read in any case, so that the name is known.
    const double value = options.getNumber(name, std::max(least, 0.0), least, most);
    return options.has(name) ? std::optional(value) : std::nullopt;
  };
  return {number("area_height_m", -1.0, 1.0), number("area_distance_m", 0.1, 1.5),
          number("area_tilt_deg", -90.0, 90.0)};
}

}  // namespace

PlacementGeometry geometry(Placement placement, xr::Hand hand, const AreaChanges& changes) {
  PlacementGeometry place = placementGeometry(placement, hand == xr::Hand::left ? -0.15 : 0.15);
  if (changes.height_m) place.offset_m.y() = *changes.height_m;
  if (changes.distance_m) place.offset_m.z() = *changes.distance_m;
  if (changes.height_m || changes.distance_m) {
    place.head_pitch_deg = headPitch_deg(elevation_rad(place));
  }
  if (changes.tilt_deg) {
    const double half_rad = 0.5 * kRadPerDeg * *changes.tilt_deg;
    place.rotation = aboutX(std::sin(half_rad), std::cos(half_rad));
    place.struck_down = *changes.tilt_deg > kLies_deg;
  }
  return place;
}

double strikeSpeed(const PlacementGeometry& place, const Vec3& velocity_mps) {
  return place.struck_down ? -velocity_mps.y() : velocity_mps.z();
}

std::span<const std::string> conditionNames() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const ConditionRow& row : kConditions) all.emplace_back(row.name);
    for (const MixRow& row : mixes()) all.emplace_back(row.name);
    const std::size_t plain = all.size();
    for (std::size_t i = 0; i < plain; ++i) {
      std::string name = all[i];
      all.push_back(name.append(kUnconstrained));
    }
    return all;
  }();
  return names;
}

std::vector<rl::GameCondition> publishedConditions() {
  static constexpr std::array<std::string_view, 3> kEvaluated{"low-medium", "medium",
                                                              "high-medium"};
  std::vector<rl::GameCondition> all;
  const auto publish = [&all](std::string_view name, std::string text,
                              std::span<const std::string_view> draws, std::string_view suffix) {
    rl::GameCondition& condition = all.emplace_back();
    condition.name = std::string(name) + std::string(suffix);
    condition.options_json = nlohmann::json{{"condition", condition.name}}.dump();
    for (const std::string_view drawn : draws) {
      condition.draws.push_back(std::string(drawn) + std::string(suffix));
    }
    condition.description = std::move(text);
    if (draws.size() == 1) {
      condition.description = "The same as " + condition.draws.front();
    } else if (!suffix.empty()) {
      condition.description += "; any touch of a target is a hit";
    }
    condition.evaluated = std::ranges::find(kEvaluated, condition.name) != kEvaluated.end();
  };
  for (const std::string_view suffix : {std::string_view(), kUnconstrained}) {
    for (const ConditionRow& row : kConditions) {
      const bool alias = !row.same_as.empty();
      publish(row.name, description(row), std::span(&row.same_as, alias ? 1 : 0), suffix);
    }
    for (const MixRow& mix : mixes()) publish(mix.name, description(mix), mix.members, suffix);
  }
  return all;
}

Condition resolveCondition(std::string_view name, std::uint32_t seed) {
  std::string_view base = name;
  const bool constrained = !base.ends_with(kUnconstrained);
  if (!constrained) base.remove_suffix(kUnconstrained.size());
  if (const MixRow* mix = findMix(base)) base = drawMember(*mix, seed);
  const ConditionRow* row = findCondition(base);
  if (row == nullptr) {
    throw InvalidArgument("option 'condition'", "'" + std::string(name) + "'",
                          oneOf(conditionNames(), name));
  }
  std::string full(base);
  if (!constrained) full += kUnconstrained;
  return {std::move(full), row->placement, row->max_targets, constrained};
}

std::string Settings::playOptionsJson() const {
  const Settings usual;
  nlohmann::json options = nlohmann::json::object();
  const auto add = [&options](const char* name, const auto& value, const auto& default_value) {
    if (value != default_value) options[name] = value;
  };
  add("round_seconds", round_s, usual.round_s);
  add("countdown_seconds", countdown_s, usual.countdown_s);
  add("fade_in_seconds", fade_in_s, usual.fade_in_s);
  add("life_seconds", life_s, usual.life_s);
  add("strike_threshold_mps", strike_threshold_mps, usual.strike_threshold_mps);
  add("velocity_smoothing", velocity_smoothing, usual.velocity_smoothing);
  add("hammer_margin_m", hammer_margin_m, usual.hammer_margin_m);
  if (area.height_m) options["area_height_m"] = *area.height_m;
  if (area.distance_m) options["area_distance_m"] = *area.distance_m;
  if (area.tilt_deg) options["area_tilt_deg"] = *area.tilt_deg;
  add("area_size_m", area_size_m, usual.area_size_m);
  add("target_radius_m", target_radius_m, usual.target_radius_m);
  add("spawn_weights", spawn_weights, usual.spawn_weights);
  if (velocity_point == VelocityPoint::kHead) options["velocity_point"] = "head";
  if (hand == xr::Hand::left) options["hand"] = "left";
  for (const ScheduledSpawn& spawn : spawns) {
    options["spawn_times"].push_back(spawn.time_s);
    options["spawn_cells"].push_back(spawn.cell);
  }
  return options.dump();
}

Settings Settings::fromOptions(Options& options) {
  static const std::vector<std::string> kRewards{"reference", "paper"};
  static const std::vector<std::string> kVelocityPoints{"root", "head"};
  static const std::vector<std::string> kHands{"right", "left"};
  Settings settings;
  settings.condition = options.getChoice("condition", settings.condition, conditionNames());
  settings.adaptive = options.getBool("adaptive", settings.adaptive);
  settings.sparse = options.getBool("sparse", settings.sparse);
  settings.reward = options.getChoice("reward", "reference", kRewards) == "paper"
                        ? RewardKind::kPaper
                        : RewardKind::kReference;
  settings.round_s = static_cast<float>(options.getNumber("round_seconds", 60.0, 0.1, 3600.0));
  settings.countdown_s = static_cast<float>(options.getNumber("countdown_seconds", 0.0, 0.0, 60.0));
  settings.head_request = options.getBool("head_request", settings.head_request);
  settings.show_controllers = options.getBool("show_controllers", settings.show_controllers);
  settings.hand =
      options.getChoice("hand", "right", kHands) == "left" ? xr::Hand::left : xr::Hand::right;
  settings.area = areaFromOptions(options);
  settings.area_size_m = options.getNumber("area_size_m", settings.area_size_m, 0.05, 1.0);
  settings.target_radius_m =
      options.getNumber("target_radius_m", settings.target_radius_m, 0.005, 0.1);
  if (settings.target_radius_m > settings.area_size_m / 4.0) {
    throw InvalidArgument("option 'target_radius_m'", std::to_string(settings.target_radius_m),
                          "at most a quarter of area_size_m, " +
                              std::to_string(settings.area_size_m) + ": targets overlap");
  }
  settings.spawns = spawnsFromOptions(options);
  settings.spawn_weights = weightsFromOptions(options);
  settings.fade_in_s = static_cast<float>(options.getNumber("fade_in_seconds", 0.1, 0.0, 60.0));
  settings.life_s = static_cast<float>(options.getNumber("life_seconds", 1.0, 0.0, 3600.0));
  settings.strike_threshold_mps =
      static_cast<float>(options.getNumber("strike_threshold_mps", 0.8, 0.0, 10.0));
  settings.velocity_smoothing = options.getNumber("velocity_smoothing", 0.5, 0.01, 1.0);
  settings.velocity_point = options.getChoice("velocity_point", "root", kVelocityPoints) == "head"
                                ? VelocityPoint::kHead
                                : VelocityPoint::kRoot;
  settings.hammer_margin_m = options.getNumber("hammer_margin_m", 0.0, -0.02, 0.1);
  return settings;
}

}  // namespace sim2vr::games::whacamole

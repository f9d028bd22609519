// SPDX-License-Identifier: Apache-2.0
#include "beats/settings.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr double kUsualHeight_m = 1.8;
constexpr ScoreRules kBeatSaberScore{.min_speed_mps = 2.0, .swing = true};

/// Beat Saber's, measured by recorded rounds (docs/reference/games/beats.md).
Layout beatSaberLayout() {
  Layout layout;
  layout.cell_width_m = 0.60;
  layout.rows_m = {0.85, 1.40, 1.90};
  layout.cut_distance_m = 0.92;
  layout.box_edge_m = 0.40;
  layout.hit_box_m = Vec3(0.80, 0.50, 1.00);
  layout.hit_box_nearer_m = 0.25;
  layout.blade_start_m = 0.0;
  return layout;
}

std::optional<std::array<double, 3>> threeNumbers(Options& options, const std::string& name,
                                                  double minimum, double maximum) {
  const std::vector<double> numbers = options.getNumbers(name, minimum, maximum);
  if (numbers.empty()) return std::nullopt;
  if (numbers.size() != 3) {
    throw InvalidArgument("option '" + name + "'", std::to_string(numbers.size()) + " numbers",
                          "three");
  }
  return std::array{numbers[0], numbers[1], numbers[2]};
}

void readRows(Options& options, Layout& layout) {
  const bool evenly = options.has("cell_height_m") || options.has("middle_row_m");
  layout.cell_height_m = options.getNumber("cell_height_m", layout.cell_height_m, 0.1, 1.0);
  layout.middle_row_m = options.getNumber("middle_row_m", layout.middle_row_m, -1.0, 3.0);
  const auto rows_m = threeNumbers(options, "row_heights_m", -1.0, 3.0);
  if (rows_m && evenly) {
    throw InvalidArgument("option 'row_heights_m'", "cell_height_m or middle_row_m as well",
                          "one or the other");
  }
  if (rows_m && !((*rows_m)[0] < (*rows_m)[1] && (*rows_m)[1] < (*rows_m)[2])) {
    throw InvalidArgument("option 'row_heights_m'", "heights out of order",
                          "bottom, middle and top row, rising");
  }
  if (rows_m || evenly) layout.rows_m = rows_m;
}

/// Rows rise with the player by half, as Beat Saber's do.
void raiseRows(Layout& layout, double player_height_m) {
  const double raise_m = std::clamp((player_height_m - kUsualHeight_m) / 2.0, -0.2, 0.6);
  layout.middle_row_m += raise_m;
  if (!layout.rows_m) return;
  for (double& row_m : *layout.rows_m) row_m += raise_m;
}

Layout layoutFromOptions(Options& options, Layout layout) {
  layout.cell_width_m = options.getNumber("cell_width_m", layout.cell_width_m, 0.1, 1.0);
  readRows(options, layout);
  layout.cut_distance_m = options.getNumber("cut_distance_m", layout.cut_distance_m, 0.2, 2.0);
  layout.box_edge_m = options.getNumber("box_edge_m", layout.box_edge_m, 0.05, 1.0);
  if (const auto hit_box_m = threeNumbers(options, "hit_box_m", 0.05, 2.0)) {
    layout.hit_box_m = Vec3((*hit_box_m)[0], (*hit_box_m)[1], (*hit_box_m)[2]);
  }
  layout.hit_box_nearer_m =
      options.getNumber("hit_box_nearer_m", layout.hit_box_nearer_m, -1.0, 1.0);
  layout.link_edge_m = options.getNumber("link_edge_m", layout.link_edge_m, 0.05, 1.0);
  layout.mine_radius_m = options.getNumber("mine_radius_m", layout.mine_radius_m, 0.01, 0.5);
  layout.head_radius_m = options.getNumber("head_radius_m", layout.head_radius_m, 0.0, 0.3);
  layout.blade_start_m = options.getNumber("blade_start_m", layout.blade_start_m, -0.5, 0.5);
  layout.blade_length_m = options.getNumber("blade_length_m", layout.blade_length_m, 0.1, 2.0);
  return layout;
}

ScoreRules scoreFromOptions(Options& options, ScoreRules rules) {
  static const std::vector<std::string> kScorings{"speed", "swing"};
  rules.swing = options.getChoice("scoring", rules.swing ? "swing" : "speed", kScorings) == "swing";
  rules.min_speed_mps = options.getNumber("min_cut_speed_mps", rules.min_speed_mps, 0.0, 10.0);
  rules.full_speed_mps = options.getNumber("full_cut_speed_mps", rules.full_speed_mps, 0.1, 50.0);
  rules.angle_limit_deg = options.getNumber("angle_limit_deg", rules.angle_limit_deg, 1.0, 180.0);
  if (rules.full_speed_mps <= rules.min_speed_mps) {
    throw InvalidArgument("option 'full_cut_speed_mps'", std::to_string(rules.full_speed_mps),
                          "more than min_cut_speed_mps, " + std::to_string(rules.min_speed_mps));
  }
  return rules;
}

}  // namespace

Settings Settings::fromOptions(Options& options) {
  static const std::vector<std::string> kRewards{"score", "shaped"};
  static const std::vector<std::string> kRules{"paper", "beat_saber"};
  static const std::vector<std::string> kOrigins{"head", "floor"};
  constexpr double kMostPoints = 1000.0;
  Settings settings;
  settings.level = readLevelSettings(options);
  const bool original = options.getChoice("rules", "paper", kRules) == "beat_saber";
  settings.layout = layoutFromOptions(options, original ? beatSaberLayout() : Layout{});
  settings.score = scoreFromOptions(options, original ? kBeatSaberScore : ScoreRules{});
  settings.floor_origin =
      options.getChoice("origin", original ? "floor" : "head", kOrigins) == "floor";
  const double height_m = options.getNumber("player_height_m", kUsualHeight_m, 0.5, 2.5);
  if (options.has("player_height_m") && !settings.floor_origin) {
    throw InvalidArgument("option 'player_height_m'", std::to_string(height_m),
                          "none with rows that count from the head: origin 'floor'");
  }
  raiseRows(settings.layout, height_m);
  settings.end_on_miss = options.getBool("end_on_miss", settings.level.level == "first");
  settings.multiplier = options.getBool("multiplier", settings.multiplier);
  settings.energy = options.getBool("energy", settings.energy);
  settings.wall_errors_per_second = options.getNumber("wall_errors_per_second", 0.0, 0.0, 100.0);
  settings.lead_in_s = options.getNumber("lead_in_seconds", 0.0, 0.0, 60.0);
  settings.time_feature = options.getBool("time_feature", settings.time_feature);
  settings.shaped = options.getChoice("reward", "score", kRewards) == "shaped";
  settings.approach_reward =
      options.getNumber("approach_reward", settings.approach_reward, 0.0, kMostPoints);
  settings.miss_penalty = options.getNumber("miss_penalty", 0.0, 0.0, kMostPoints);
  settings.error_penalty = options.getNumber("error_penalty", 0.0, 0.0, kMostPoints);
  return settings;
}

}  // namespace sim2vr::games::beats

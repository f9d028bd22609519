#include "beats/settings.hpp"

#include <string>
#include <vector>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats {
namespace {

Layout layoutFromOptions(Options& options) {
  Layout layout;
  layout.cell_width_m = options.getNumber("cell_width_m", layout.cell_width_m, 0.1, 1.0);
  layout.cell_height_m = options.getNumber("cell_height_m", layout.cell_height_m, 0.1, 1.0);
  layout.middle_row_m = options.getNumber("middle_row_m", layout.middle_row_m, -1.0, 1.0);
  layout.cut_distance_m = options.getNumber("cut_distance_m", layout.cut_distance_m, 0.2, 2.0);
  layout.box_edge_m = options.getNumber("box_edge_m", layout.box_edge_m, 0.05, 1.0);
  layout.link_edge_m = options.getNumber("link_edge_m", layout.link_edge_m, 0.05, 1.0);
  layout.mine_radius_m = options.getNumber("mine_radius_m", layout.mine_radius_m, 0.01, 0.5);
  layout.head_radius_m = options.getNumber("head_radius_m", layout.head_radius_m, 0.0, 0.3);
  layout.blade_length_m = options.getNumber("blade_length_m", layout.blade_length_m, 0.1, 2.0);
  return layout;
}

ScoreRules scoreFromOptions(Options& options) {
  ScoreRules rules;
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
  constexpr double kMostPoints = 1000.0;
  Settings settings;
  settings.level = readLevelSettings(options);
  settings.layout = layoutFromOptions(options);
  settings.score = scoreFromOptions(options);
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

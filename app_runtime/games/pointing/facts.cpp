// How rounds of pointing are measured; docs/reference/games/pointing.md has the formulas.
#include <nlohmann/json.hpp>

#include "pointing/game.hpp"

namespace sim2vr::games::pointing {
namespace {

std::vector<rl::Measure> measures() {
  return {
      {.name = "hits", .label = "Hits", .log_key = "Points"},
      {.name = "errors",
       .label = "Errors",
       .log_key = "Errors",
       .better = rl::Better::kLower,
       .description = "Selections beside the target"},
      {.name = "timeouts",
       .label = "Time-outs",
       .log_key = "Timeouts",
       .better = rl::Better::kLower,
       .description = "Targets that went away without a selection"},
      {.name = "hit_rate",
       .label = "Hit rate",
       .log_key = "Points",
       .digits = 3,
       .description = "Hits / targets that came up, from 0 to 1",
       .rate_with = "Failures"},
      {.name = "movement_time_s",
       .label = "Movement time",
       .unit = "s",
       .log_key = "MovementTime",
       .better = rl::Better::kLower,
       .digits = 3,
       .description = "From one selection to the next, mean",
       .only_if = "Movements"},
      {.name = "throughput_bps",
       .label = "Throughput",
       .unit = "bit/s",
       .log_key = "Throughput",
       .digits = 2,
       .description = "Effective index of difficulty / movement time, mean over the blocks",
       .only_if = "Blocks"},
      {.name = "endpoint_spread_m",
       .label = "Endpoint spread",
       .unit = "m",
       .log_key = "EndpointSpread",
       .better = rl::Better::kNone,
       .digits = 4,
       .description = "Standard deviation of the selections along the way to the target",
       .only_if = "Blocks"},
      {.name = "index_of_difficulty_bits",
       .label = "Index of difficulty",
       .unit = "bit",
       .log_key = "IndexOfDifficulty",
       .better = rl::Better::kNone,
       .digits = 2,
       .description = "Nominal, mean over the movements",
       .only_if = "Movements"},
      {.name = "effective_index_bits",
       .label = "Effective index",
       .unit = "bit",
       .log_key = "EffectiveIndex",
       .better = rl::Better::kNone,
       .digits = 2,
       .description = "Of the distances and widths that were really used, mean over the blocks",
       .only_if = "Blocks"},
  };
}

rl::GameCondition plane(const std::string& name, const std::string& where, double depth_m) {
  return {.name = name,
          .description = "Nine indices of difficulty on a plane " + where,
          .options_json = nlohmann::json{{"depth_m", depth_m}}.dump(),
          .evaluated = true};
}

}  // namespace

rl::GameFacts Pointing::facts() const {
  rl::GameFacts facts;
  facts.devices = {"controller_right"};
  facts.hand_option = "hand";
  facts.measures = measures();
  facts.score = "throughput_bps";
  facts.reward_terms = {{"DistanceReward", "target closeness"}, {"ErrorReward", "errors"}};
  facts.reward_rest = "hits";
  facts.items = {{.name = "target",
                  .id_field = "target ID",
                  .begin_event = "target_spawn",
                  .outcomes = {{"target_hit", "hit", true},
                               {"target_error", "error", false},
                               {"target_miss", "timeout", false}},
                  .cell_field = "grid ID",
                  .place_field = "center"}};
  facts.conditions = {
      plane("near", "30 cm before the eyes", 0.30),
      plane("mid", "40 cm before the eyes", 0.40),
      plane("far", "50 cm before the eyes", 0.50),
  };
  facts.default_condition = "mid";
  return facts;
}

}  // namespace sim2vr::games::pointing

// How rounds of Whac-A-Mole are measured. Definitions follow the released analysis of the user
// study, so that a simulated user's numbers compare with people's.
// docs/reference/games/whacamole.md has the log's.
#include "whacamole/conditions.hpp"
#include "whacamole/game.hpp"

namespace sim2vr::games::whacamole {
namespace {

constexpr int kRows = 3;
constexpr int kColumns = 3;
static_assert(kRows * kColumns == kCells);

std::vector<rl::Measure> measures() {
  return {
      {.name = "hits", .label = "Hits", .log_key = "Points"},
      {.name = "misses",
       .label = "Misses",
       .log_key = "Misses",
       .better = rl::Better::kLower,
       .description = "Targets that went away unhit"},
      {.name = "contacts",
       .label = "Contacts (too slow)",
       .log_key = "Contacts",
       .better = rl::Better::kLower,
       .description = "Touches of a target that were too slow to be a hit"},
      {.name = "hit_rate",
       .label = "Hit rate",
       .log_key = "Points",
       .digits = 3,
       .description = "Hits / (hits + misses), from 0 to 1",
       .rate_with = "Misses"},
      {.name = "hit_speed_mps",
       .label = "Hitting speed",
       .unit = "m/s",
       .log_key = "HitSpeed",
       .better = rl::Better::kNone,
       .digits = 2,
       .description = "Of the hammer near the hand, mean over the hits",
       .only_if = "Points"},
      {.name = "hammer_depth_m",
       .label = "Hammer depth",
       .unit = "m",
       .log_key = "HammerDepthZ",
       .better = rl::Better::kNone,
       .digits = 3,
       .description = "Its face behind the targets' plane; negative: in front of it"},
      {.name = "cell_hit_rates",
       .label = "Hit rate per cell",
       .log_key = "hitsTarget",
       .digits = 2,
       .description = "Cells are counted row by row from 0 at the top left",
       .rate_with = "missesTarget",
       .grid = rl::Measure::Grid{kRows, kColumns}},
  };
}

}  // namespace

rl::GameFacts WhacAMole::facts() const {
  const Settings usual;
  rl::GameFacts facts;
  facts.id = "WhacAMole";
  facts.round_seconds = usual.round_s;
  facts.devices = {"controller_right"};
  facts.hand_option = "hand";
  facts.measures = measures();
  facts.score = "hit_rate";
  facts.reward_terms = {{"DistanceReward", "target closeness"},
                        {"RewardUnsuccessfulContact", "slow contacts"}};
  facts.reward_rest = "hits";
  facts.items = {{.name = "target",
                  .id_field = "target ID",
                  .begin_event = "target_spawn",
                  .outcomes = {{"target_hit", "hit", true}, {"target_miss", "miss", false}},
                  .counted_events = {"target_contact"},
                  .cell_field = "grid ID",
                  .places_event = "grid mapping",
                  .velocity_field = "velocity"}};
  facts.conditions = publishedConditions();
  facts.default_condition = usual.condition;
  // As in the reference's evaluator: a curriculum favours the targets that a user fails at, so that
  // hit rates would not compare.
  facts.evaluation_options_json = R"({"adaptive": false})";
  return facts;
}

}  // namespace sim2vr::games::whacamole

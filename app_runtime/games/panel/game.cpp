// SPDX-License-Identifier: Apache-2.0
#include "panel/game.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "panel/looks.hpp"
#include "panel/round.hpp"

namespace sim2vr::games::panel {
namespace {

/// Reward of a frame: 10 for a widget operated as wanted, minus the error's cost for anything else
/// that was operated, plus (exp(-5 g) - 1) / 10 per user step, with g the angle, rad, or the
/// distance, m, of the nearer hand from what has to be pressed. "sparse" leaves the last term out.
class Env : public rl::RLEnv {
 public:
  explicit Env(const Round& round) : round_(round) {}

  std::string_view typeName() const override { return "panel.Env"; }
  void declareLog() override;
  double calculateReward() override;
  bool isOver() const override { return round_.over(); }
  float timeFeature() const override { return static_cast<float>(2.0 * round_.progress() - 1.0); }
  void fields(Archive& archive) override;

 private:
  double closenessReward() const;

  const Round& round_;
  int hits_ = 0;
  int errors_ = 0;
  // Of the present frame.
  double error_ = 0.0;
  double closeness_ = 0.0;
};

constexpr double kHitReward = 10.0;
constexpr double kClosenessRate = 5.0;
constexpr double kClosenessWeight = 0.1;
/// In the log: a number that the round has not.
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

void Env::declareLog() {
  const bool sparse = round_.settings().sparse;
  logTerm("ErrorReward", [this] { return error_; });
  logTerm("ClosenessReward", [this, sparse] { return sparse ? kNone : closeness_; });
  const Tally& tally = round_.tally();
  logColumn("Points", [&] { return tally.hits; });
  logColumn("Errors", [&] { return tally.errors; });
  logColumn("Timeouts", [&] { return tally.timeouts; });
  logColumn("MissedFirst", [&] { return tally.missed_first; });
  logColumn("HitFirst", [&] { return tally.targets - tally.missed_first; });
  logColumn("SelectionTime", [&] { return tally.meanTime_s(); });
  logColumn("MedianSelectionTime", [&] { return tally.medianTime_s(); });
}

double Env::calculateReward() {
  const Tally& tally = round_.tally();
  error_ = -round_.settings().error_cost * (tally.errors - errors_);
  closeness_ = round_.settings().sparse ? 0.0 : closenessReward();
  const double hit = kHitReward * (tally.hits - hits_);
  hits_ = tally.hits;
  errors_ = tally.errors;
  return hit + error_ + closeness_;
}

double Env::closenessReward() const {
  double gap = std::numeric_limits<double>::infinity();
  for (const Pointer& pointer : round_.pointers()) {
    if (pointer.state().active) gap = std::min(gap, pointer.gap(round_.handle_m()));
  }
  return kClosenessWeight * (std::exp(-kClosenessRate * gap) - 1.0) / framesPerStep();
}

void Env::fields(Archive& archive) {
  RLEnv::fields(archive);
  archive.field("hits", hits_, kCounts);
  archive.field("errors", errors_, kCounts);
}

std::vector<rl::Measure> measures() {
  return {
      {.name = "hits", .label = "Hits", .log_key = "Points", .description = "Widgets operated"},
      {.name = "errors",
       .label = "Errors",
       .log_key = "Errors",
       .better = rl::Better::kLower,
       .description = "Another widget, another goal, or a trigger pulled beside everything"},
      {.name = "error_rate",
       .label = "Error rate",
       .log_key = "MissedFirst",
       .better = rl::Better::kLower,
       .digits = 3,
       .description = "Targets whose first operation was an error / targets, from 0 to 1",
       .rate_with = "HitFirst"},
      {.name = "timeouts",
       .label = "Time-outs",
       .log_key = "Timeouts",
       .better = rl::Better::kLower,
       .description = "Targets that went away"},
      {.name = "selection_time_s",
       .label = "Selection time",
       .unit = "s",
       .log_key = "MedianSelectionTime",
       .better = rl::Better::kLower,
       .digits = 3,
       .description = "From a target's appearance to its operation, median of the round",
       .only_if = "Points"},
      {.name = "mean_selection_time_s",
       .label = "Mean selection time",
       .unit = "s",
       .log_key = "SelectionTime",
       .better = rl::Better::kLower,
       .digits = 3,
       .only_if = "Points"},
  };
}

rl::GameCondition condition(const std::string& name, const std::string& description,
                            const nlohmann::json& changed, bool evaluated) {
  // All conditions set the same options.
  nlohmann::json options{
      {"select", "ray"}, {"widgets", "buttons"}, {"distance_m", 1.5}, {"columns", 3},
      {"rows", 4},       {"button_m", 0.12},     {"pitch_m", 0.20}};
  options.update(changed);
  return {.name = name,
          .description = description,
          .options_json = options.dump(),
          .evaluated = evaluated};
}

}  // namespace

rl::GameFacts Panel::facts() const {
  rl::GameFacts facts;
  facts.round_seconds = 20.0;
  facts.devices = {"controller_right"};
  facts.inputs = {"right.trigger"};
  facts.hand_option = "hand";
  facts.measures = measures();
  facts.score = "hits";
  facts.reward_terms = {{"ClosenessReward", "closeness"}, {"ErrorReward", "errors"}};
  facts.reward_rest = "hits";
  facts.items = {{.name = "target",
                  .id_field = "target ID",
                  .begin_event = "target_spawn",
                  .outcomes = {{"target_hit", "hit", true}, {"target_miss", "timeout", false}},
                  .counted_events = {"target_error"},
                  .cell_field = "grid ID",
                  .place_field = "center"}};
  facts.conditions = {
      condition("keypad", "Twelve buttons of 12 cm at 1.5 m, by ray", nlohmann::json::object(),
                true),
      condition("touch", "Twelve buttons of 3.6 cm at 45 cm, by fingertip",
                {{"select", "touch"}, {"distance_m", 0.45}, {"button_m", 0.036}, {"pitch_m", 0.06}},
                false),
      condition(
          "far", "25 buttons of 10 cm at 5 m, by ray",
          {{"distance_m", 5.0}, {"columns", 5}, {"rows", 5}, {"button_m", 0.10}, {"pitch_m", 0.50}},
          false),
      condition("sliders", "Three sliders, by ray", {{"widgets", "sliders"}}, false),
      condition("dial", "A dial, by ray", {{"widgets", "dial"}}, false),
      condition("list", "A list that scrolls, by ray", {{"widgets", "list"}}, false),
      condition("mixed", "Everything, by ray", {{"widgets", "mixed"}}, false),
  };
  facts.default_condition = "keypad";
  return facts;
}

rl::RLEnv& Panel::build(rl::GameContext& context) {
  scene::Scene& scene = context.scene;
  const Controls controls = Controls::make(context.xr);
  const rl::XrRig rig = rl::buildXrRig(context);
  addRoomLooks(scene, rig, settings_.select);

  RoundSetup setup{settings_, context.seed, rig, {}, context.logger, &context.sounds};
  for (const xr::Hand hand : settings_.hands) {
    const auto* controller = hand == xr::Hand::left ? rig.left_controller : rig.right_controller;
    setup.pointers.emplace_back(*controller, hand, context.xr, controls, settings_.select);
  }
  scene::GameObject& panel = scene.create("Panel");
  auto& round = panel.addComponent<Round>(std::move(setup));
  panel.addComponent<Looks>(round);
  return scene.create("RL Environment").addComponent<Env>(round);
}

}  // namespace sim2vr::games::panel

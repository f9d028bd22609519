// SPDX-License-Identifier: Apache-2.0
#include "pointing/game.hpp"

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <span>
#include <utility>

#include "pointing/looks.hpp"
#include "pointing/privileged.hpp"
#include "pointing/round.hpp"
#include "sim2vr/rl/game.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::pointing {
namespace {

/// Reward of a frame: 10 for a hit, minus the error's cost for a selection beside the target, plus
/// (exp(-10 d) - 1) / 10 per user step with d, m, from the tip to the centre of the target that is
/// up. "sparse" leaves the last term out.
class Env : public rl::RLEnv {
 public:
  Env(const Round& round, Privileged privileged)
      : round_(round), privileged_(std::move(privileged)) {}

  std::string_view typeName() const override { return "pointing.Env"; }
  void declareLog() override;
  double calculateReward() override;
  bool isOver() const override { return round_.phase() == Round::Phase::kDone; }
  float timeFeature() const override { return static_cast<float>(2.0 * round_.progress() - 1.0); }
  void fillPrivileged(std::span<float> values) const override { privileged_.fill(values); }
  void fields(Archive& archive) override;

 private:
  double distanceReward() const;

  const Round& round_;
  Privileged privileged_;
  int hits_ = 0;
  int errors_ = 0;
  // Of the present frame.
  double error_ = 0.0;
  double distance_ = 0.0;
};

constexpr double kHitReward = 10.0;
constexpr double kDistanceRate_per_m = 10.0;
constexpr double kDistanceWeight = 0.1;
/// In the log: a number that the round has not.
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

double meanOf(double sum, int count) { return count == 0 ? 0.0 : sum / count; }

void Env::declareLog() {
  const auto trials = static_cast<double>(round_.blocks().size()) * (round_.settings().targets + 1);
  logColumn("Trials", [trials] { return trials; });
  const bool sparse = round_.settings().sparse;
  logTerm("ErrorReward", [this] { return error_; });
  logTerm("DistanceReward", [this, sparse] { return sparse ? kNone : distance_; });
  const Tally& tally = round_.tally();
  logColumn("Points", [&] { return tally.hits; });
  logColumn("Errors", [&] { return tally.errors; });
  logColumn("Timeouts", [&] { return tally.timeouts; });
  logColumn("Failures", [&] { return tally.failures(); });
  logColumn("Selections", [&] { return tally.hits + tally.errors; });
  logColumn("Movements", [&] { return tally.movements; });
  logColumn("MovementTime", [&] { return meanOf(tally.time_sum_s, tally.movements); });
  logColumn("IndexOfDifficulty", [&] { return meanOf(tally.index_sum_bits, tally.movements); });
  logColumn("Blocks", [&] { return tally.blocks; });
  logColumn("Throughput", [&] { return meanOf(tally.throughput_sum_bps, tally.blocks); });
  logColumn("EffectiveIndex", [&] { return meanOf(tally.effective_index_sum_bits, tally.blocks); });
  logColumn("EndpointSpread",
            [&] { return std::sqrt(meanOf(tally.variance_sum_m2, tally.blocks)); });
}

double Env::calculateReward() {
  const Tally& tally = round_.tally();
  error_ = -round_.settings().error_cost * (tally.errors - errors_);
  distance_ = round_.settings().sparse ? 0.0 : distanceReward();
  const double hit = kHitReward * (tally.hits - hits_);
  hits_ = tally.hits;
  errors_ = tally.errors;
  privileged_.look();
  return hit + error_ + distance_;
}

double Env::distanceReward() const {
  if (round_.phase() != Round::Phase::kPlay) return 0.0;
  const double distance_m = (round_.targetCenter(round_.target()) - round_.stylus().tip_m()).norm();
  return kDistanceWeight * (std::exp(-kDistanceRate_per_m * distance_m) - 1.0) / framesPerStep();
}

void Env::fields(Archive& archive) {
  RLEnv::fields(archive);
  archive.field("hits", hits_, kCounts);
  archive.field("errors", errors_, kCounts);
  archive.field("privileged", privileged_);
}

}  // namespace

rl::RLEnv& Pointing::build(rl::GameContext& context) {
  scene::Scene& scene = context.scene;
  const Feedback feedback(context.xr, context.sounds, settings_.hand);
  const rl::XrRig rig = rl::buildXrRig(context);
  scene::GameObject& controller =
      settings_.hand == xr::Hand::left ? *rig.left_controller : *rig.right_controller;
  addStylusLooks(controller, settings_.stylus_m);
  addRoomLooks(scene, *rig.camera, settings_.hand);

  auto& round = scene.create("Round").addComponent<Round>(RoundSetup{
      settings_, context.seed, rig, Stylus(controller, settings_.stylus_m, settings_.rearm_m),
      feedback, context.logger});
  scene.create("Board").addComponent<Board>(round);
  return scene.create("RL Environment")
      .addComponent<Env>(round, Privileged(round, *rig.camera, context.xr.settings().aspect));
}

std::optional<double> Pointing::headRequest(std::uint32_t) const {
  if (!settings_.head_request) return std::nullopt;
  return std::atan2(settings_.height_m, settings_.depth_m) * 180.0 / std::numbers::pi;
}

const std::vector<std::string>& Pointing::privilegedNames() const { return Privileged::names(); }

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

// docs/reference/games/pointing.md has the formulas.
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

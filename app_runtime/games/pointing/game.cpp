// SPDX-License-Identifier: Apache-2.0
#include "pointing/game.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <utility>

#include "pointing/looks.hpp"
#include "sim2vr/rl/privileged_table.hpp"
#include "sim2vr/rl/view_frustum.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::pointing {
namespace {

// Where the target is in the picture and how wide, in yes and no: thresholds on its centre's place
// from the circle's centre and on its width.
constexpr std::array kShownPlaces_m{-0.14, -0.10, -0.06, -0.02, 0.02, 0.06, 0.10, 0.14};
constexpr std::array kShownWidths_m{0.025, 0.0375};

// What the table's getters read.
struct Source {
  const Round& round;
  Vec3 head_m;
  bool present;  // the target, and in view
  double start_distance_m;

  Vec3 target_m() const { return round.targetCenter(round.target()); }
  std::optional<int> next() const { return present ? round.nextTarget() : std::nullopt; }
};

rl::PrivilegedTable<Source> makeTable() {
  rl::PrivilegedTable<Source> table;
  const auto tip_m = [](const Source& s) { return s.round.stylus().tip_m(); };
  constexpr std::array kCenters{"round.side_m", "round.height_m", "round.depth_m"};
  for (int axis = 0; axis < 3; ++axis) {
    table.number(kCenters[axis],
                 [axis](const Source& s) { return s.round.settings().center_m()[axis]; });
  }
  table.number("round.progress", [](const Source& s) { return s.round.progress(); });
  table.vector("tip.", "_m", [=](const Source& s) -> Vec3 { return tip_m(s) - s.head_m; });
  table.vector("tip.v", "_mps", [](const Source& s) { return s.round.stylus().velocity_mps(); });
  table.number("tip.depth_m",
               [=](const Source& s) { return tip_m(s).z() - s.round.center_m().z(); });
  table.number("tip.armed", [](const Source& s) { return s.round.stylus().armed(); });

  table.number("target.present", [](const Source& s) { return s.present; });
  table.number("target.start", [](const Source& s) { return s.present && s.round.trial() == 0; });
  table.number("target.width_m",
               [](const Source& s) { return s.present ? s.round.block().width_m : 0.0; });
  table.number("target.age_s", [](const Source& s) { return s.present ? s.round.age_s() : 0.0; });
  table.vector("target.", "_m", [=](const Source& s) {
    return s.present ? Vec3(s.target_m() - tip_m(s)) : Vec3(Vec3::Zero());
  });
  table.vector("target.place_", "_m", [](const Source& s) {
    return s.present ? Vec3(s.target_m() - s.head_m) : Vec3(Vec3::Zero());
  });
  table.number("next.present", [](const Source& s) { return s.next().has_value(); });
  table.vector("next.place_", "_m", [](const Source& s) {
    const auto next = s.next();
    return next ? Vec3(s.round.targetCenter(*next) - s.head_m) : Vec3(Vec3::Zero());
  });
  for (int axis = 0; axis < 2; ++axis) {
    for (std::size_t i = 0; i < kShownPlaces_m.size(); ++i) {
      table.number(std::string("shown.") + "xy"[axis] + std::to_string(i),
                   [axis, least_m = kShownPlaces_m[i]](const Source& s) {
                     const Vec3 place_m = s.target_m() - s.round.center_m();
                     return s.present && place_m[axis] > least_m;
                   });
    }
  }
  for (std::size_t i = 0; i < kShownWidths_m.size(); ++i) {
    table.number("shown.width" + std::to_string(i), [least_m = kShownWidths_m[i]](const Source& s) {
      return s.present && s.round.block().width_m > least_m;
    });
  }
  table.number("aid.start_distance_m", [](const Source& s) { return s.start_distance_m; });
  table.number("aid.start_cell", [](const Source&) { return 0.0; });
  return table;
}

const rl::PrivilegedTable<Source>& table() {
  static const auto table = makeTable();
  return table;
}

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

const std::vector<std::string>& Privileged::names() { return table().names(); }

void Privileged::look() {
  if (round_->phase() != Round::Phase::kPlay) return;
  const auto& camera = *camera_->getComponent<render::Camera>();
  if (rl::inView(camera, aspect_, round_->targetCenter(round_->target()))) {
    seen_id_ = round_->targetId();
  }
}

bool Privileged::seen() const {
  return round_->phase() == Round::Phase::kPlay && seen_id_ == round_->targetId();
}

double Privileged::startDistance_m() const {
  const Settings& settings = round_->settings();
  const Vec3 tip_m = round_->stylus().tip_m() - round_->center_m();
  double least_m = std::numeric_limits<double>::infinity();
  for (const double distance_m : settings.distances_m) {
    for (int target = 0; target < settings.targets; ++target) {
      const Vec3 start_m =
          targetCenter_m(target, settings.targets, distance_m) - Vec3(0.0, 0.0, kTapStart_m);
      least_m = std::min(least_m, (start_m - tip_m).norm());
    }
  }
  return least_m;
}

void Privileged::fill(std::span<float> values) const {
  const Vec3 head_m = camera_->transform().position();
  table().fill({*round_, head_m, seen(), startDistance_m()}, values);
}

void Privileged::fields(Archive& archive) {
  archive.field("seen_id", seen_id_, {-1.0, kCounts.high});
}

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

// SPDX-License-Identifier: Apache-2.0
#include "whacamole/game.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "sim2vr/physics/world.hpp"
#include "sim2vr/rl/game.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/session.hpp"
#include "whacamole/conditions.hpp"
#include "whacamole/hammer.hpp"
#include "whacamole/layers.hpp"
#include "whacamole/looks.hpp"
#include "whacamole/privileged.hpp"
#include "whacamole/round.hpp"
#include "whacamole/target.hpp"

namespace sim2vr::games::whacamole {
namespace {

/// Reward of a frame:
///   reference  10 dPoints + 2 dFirstContacts max(0, s) / 0.8 + sum over live targets (exp(-10 d) -
///   1) / 10 paper      10 dPoints - 2 dFirstContacts max(0, s) / 0.8 + sum over live targets
///   (exp(-10 d) - 1)
/// with s the strike speed of the latest contact, m/s, and d the distance from a target's origin to
/// the hammer's marker, m. "sparse" keeps the first term only. The user's effort is not the app's
/// matter.
class Env : public rl::RLEnv {
 public:
  Env(const Round& round, Privileged privileged)
      : round_(round), privileged_(std::move(privileged)) {}

  std::string_view typeName() const override { return "whacamole.Env"; }
  void beginRound() override;
  void declareLog() override;
  double calculateReward() override;
  bool isOver() const override;
  float timeFeature() const override;
  void fillPrivileged(std::span<float> values) const override { privileged_.fill(values); }
  void fields(Archive& archive) override;

 private:
  double contactReward() const;
  double distanceReward() const;

  const Round& round_;
  Privileged privileged_;
  int points_ = 0;
  int first_contacts_ = 0;
  // Of the present frame.
  double contact_ = 0.0;
  double distance_ = 0.0;
};

constexpr double kPointReward = 10.0;
constexpr double kContactReward = 2.0;
constexpr double kDistanceRate_per_m = 10.0;
constexpr double kReferenceDistanceWeight = 0.1;
/// In the log: a number that the round has not.
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

double meanOf(double sum, int count) { return count == 0 ? 0.0 : sum / count; }

void Env::beginRound() {
  points_ = round_.counts().hits;
  first_contacts_ = round_.counts().first_contacts;
}

void Env::declareLog() {
  const Condition& condition = round_.condition();
  logColumn("Placement", [&] { return static_cast<double>(condition.placement) - 1.0; });
  logColumn("MaxTargets", [&] { return condition.max_targets; });
  logColumn("Constrained", [&] { return condition.constrained ? 1.0 : 0.0; });
  const bool sparse = round_.settings().sparse;
  logTerm("RewardUnsuccessfulContact", [this, sparse] { return sparse ? kNone : contact_; });
  logTerm("DistanceReward", [this, sparse] { return sparse ? kNone : distance_; });
  const Counts& counts = round_.counts();
  logColumn("Points", [&] { return counts.hits; });
  logColumn("Misses", [&] { return counts.misses; });
  logColumn("Contacts", [&] { return counts.contacts; });
  logColumn("HitSpeedSum", [&] { return counts.hit_speed_sum_mps; });
  logColumn("HitSpeed", [&] { return meanOf(counts.hit_speed_sum_mps, counts.hits); });
  logColumn("HitLatency", [&] { return meanOf(counts.hit_latency_sum_s, counts.hits); });
  logColumn("HammerDepthZ", [&] { return meanOf(counts.depth_z_sum_m, counts.play_frames); });
  logColumn("HammerDepthNormal",
            [&] { return meanOf(counts.depth_normal_sum_m, counts.play_frames); });
  for (int cell = 0; cell < kCells; ++cell) {
    const std::string number = std::to_string(cell);
    const auto i = static_cast<std::size_t>(cell);
    logColumn("failrateTarget" + number, [this, cell] { return round_.tally().failRate(cell); });
    logColumn("hitsTarget" + number, [this, i] { return round_.tally().hits[i]; });
    logColumn("missesTarget" + number, [this, i] { return round_.tally().misses[i]; });
  }
}

double Env::calculateReward() {
  double reward = kPointReward * (round_.counts().hits - points_);
  contact_ = contactReward();
  distance_ = distanceReward();
  if (!round_.settings().sparse) reward += contact_ + distance_;
  points_ = round_.counts().hits;
  first_contacts_ = round_.counts().first_contacts;
  privileged_.look();
  return reward;
}

double Env::contactReward() const {
  const Counts& counts = round_.counts();
  const double strike = std::max(0.0, counts.last_contact_strike_mps);
  const double sign = round_.settings().reward == RewardKind::kPaper ? -1.0 : 1.0;
  return sign * kContactReward * (counts.first_contacts - first_contacts_) * strike /
         static_cast<double>(kStrikeThreshold_mps);
}

double Env::distanceReward() const {
  const double weight =
      round_.settings().reward == RewardKind::kPaper ? 1.0 : kReferenceDistanceWeight;
  const Vec3 marker = round_.hammer().markerPosition();
  double sum = 0.0;
  scene().forEach<Target>([&](Target& target) {
    if (target.state() != Target::State::kAlive) return;
    const double distance_m = (target.transform().position() - marker).norm();
    sum += weight * (std::exp(-kDistanceRate_per_m * distance_m) - 1.0);
  });
  return sum / framesPerStep();
}

bool Env::isOver() const { return round_.phase() == Round::Phase::kDone; }

float Env::timeFeature() const {
  return 2.0F * (round_.elapsed_s() / round_.settings().round_s) - 1.0F;
}

void Env::fields(Archive& archive) {
  RLEnv::fields(archive);
  archive.field("points", points_, kCounts);
  archive.field("first_contacts", first_contacts_, kCounts);
  archive.field("privileged", privileged_);
}

void restrictCollisions(physics::PhysicsWorld& physics) {
  for (int a = 0; a < physics::kLayers; ++a) {
    for (int b = a; b < physics::kLayers; ++b) {
      physics.setLayerCollision(a, b, a == kTargetLayer && b == kPlayerLayer);
    }
  }
}

scene::GameObject& buildArea(scene::Scene& scene, const Settings& settings) {
  scene::GameObject& area = scene.create("Target Area");
  // It reaches a target's radius beyond the outer cells' centres.
  addAreaLooks(area, settings.area_size_m + 2.0 * settings.target_radius_m);
  area.setActive(false);
  return area;
}

}  // namespace

void WhacAMole::configure(Options& options) { settings_ = Settings::fromOptions(options); }

rl::RLEnv& WhacAMole::build(rl::GameContext& context) {
  scene::Scene& scene = context.scene;
  restrictCollisions(context.physics);

  RoundSetup setup;
  setup.settings = settings_;
  setup.condition = resolveCondition(settings_.condition, context.seed);
  setup.seed = context.seed;
  if (settings_.adaptive && settings_.spawn_weights.empty()) {
    setup.settings.spawn_weights = adaptiveWeights(tally_.failRates());
  }
  tally_ = CellTally{};

  setup.rig = rl::buildXrRig(context);
  scene::GameObject& controller =
      settings_.hand == xr::Hand::left ? *setup.rig.left_controller : *setup.rig.right_controller;
  if (settings_.show_controllers) addControllerLooks(controller, settings_.hand);
  Hammer& hammer = buildHammer(controller, settings_);
  setup.area = &buildArea(scene, settings_);
  setup.hammer = &hammer;
  setup.tally = &tally_;
  setup.logger = context.logger;

  auto& round = scene.create("Round").addComponent<Round>(setup);
  registerTargetPrefab(scene, round, hammer);
  auto& env = scene.create("RL Environment")
                  .addComponent<Env>(round, Privileged(round, *setup.rig.camera, *setup.area,
                                                       context.xr.settings().aspect));
  addRoomLooks(scene, settings_.hand);
  return env;
}

std::optional<double> WhacAMole::headRequest(std::uint32_t seed) const {
  if (!settings_.head_request) return std::nullopt;
  const Placement placement = resolveCondition(settings_.condition, seed).placement;
  return geometry(placement, settings_.hand, settings_.area).head_pitch_deg;
}

const std::vector<std::string>& WhacAMole::privilegedNames() const { return Privileged::names(); }

void WhacAMole::fields(Archive& archive) { archive.field("tally", tally_); }

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

// Definitions follow the released analysis of the user study, so that a simulated user's numbers
// compare with people's. docs/reference/games/whacamole.md has the log's.
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

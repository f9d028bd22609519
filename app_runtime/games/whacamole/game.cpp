// SPDX-License-Identifier: Apache-2.0
#include "whacamole/game.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <utility>

#include "sim2vr/physics/collider.hpp"
#include "sim2vr/physics/world.hpp"
#include "sim2vr/rl/privileged_table.hpp"
#include "sim2vr/rl/view_frustum.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/session.hpp"
#include "whacamole/looks.hpp"

namespace sim2vr::games::whacamole {
namespace {

bool hasEnded(const Target& target) { return target.state() == Target::State::kFadeOut; }

const Target* firstAlive(const std::vector<const Target*>& targets) {
  const auto found = std::find_if(targets.begin(), targets.end(), [](const Target* target) {
    return target->state() == Target::State::kAlive;
  });
  return found == targets.end() ? nullptr : *found;
}

const Target* nearest(const std::vector<const Target*>& targets, const Vec3& point_m) {
  const auto distance = [&point_m](const Target* target) {
    return (target->hitCenter_m() - point_m).squaredNorm();
  };
  const auto found = std::min_element(
      targets.begin(), targets.end(),
      [&distance](const Target* a, const Target* b) { return distance(a) < distance(b); });
  return found == targets.end() ? nullptr : *found;
}

// What the table's getters read. Of targets only those that the head camera has shown, null where
// there is none.
struct Source {
  const Round& round;
  const Hammer& hammer;
  Vec3 marker_m;
  Vec3 marker_velocity_mps;
  Vec3 head_m;
  const scene::Transform& area;
  double now_s;
  std::array<const Target*, kCells> cells{};
  std::array<const Target*, Privileged::kNext> next{};
  const Target* nearest = nullptr;
  double progress_m;
  double strike;
  double start_distance_m = std::numeric_limits<double>::infinity();
  int start_cell = 0;
};

using Table = rl::PrivilegedTable<Source>;

void addTarget(Table& table, const std::string& name,
               const std::function<const Target*(const Source&)>& target) {
  table.number(name + "present", [=](const Source& s) { return target(s) != nullptr; });
  table.number(name + "alive", [=](const Source& s) {
    return target(s) != nullptr && target(s)->state() == Target::State::kAlive;
  });
  table.number(name + "overlap", [=](const Source& s) {
    return target(s) != nullptr &&
           physics::overlaps(*s.hammer.gameObject().getComponent<physics::Collider>(),
                             *target(s)->gameObject().getComponent<physics::Collider>());
  });
  table.number(name + "life_s", [=](const Source& s) {
    return target(s) == nullptr ? 0.0 : target(s)->expiry_s() - s.now_s;
  });
  table.vector(name, "_m", [=](const Source& s) {
    return target(s) == nullptr ? Vec3(Vec3::Zero()) : Vec3(target(s)->hitCenter_m() - s.marker_m);
  });
}

Table makeTable() {
  Table table;
  constexpr std::array kPlacements{std::pair{"round.low", Placement::kLow},
                                   std::pair{"round.mid", Placement::kMid},
                                   std::pair{"round.high", Placement::kHigh}};
  for (const auto& [name, placement] : kPlacements) {
    table.number(name, [placement = placement](const Source& s) {
      return s.round.condition().placement == placement;
    });
  }
  table.number("round.constrained",
               [](const Source& s) { return s.round.condition().constrained; });
  table.number("round.max_targets",
               [](const Source& s) { return s.round.condition().max_targets; });
  table.number("round.strike_threshold_mps", [](const Source& s) {
    return s.round.condition().constrained ? s.round.settings().strike_threshold_mps : 0.0;
  });
  table.number("round.elapsed_s", [](const Source& s) { return s.round.elapsed_s(); });
  const auto rotation = [](const Source& s) { return s.hammer.transform().rotation(); };
  table.vector("hammer.", "_m", [](const Source& s) -> Vec3 { return s.marker_m - s.head_m; });
  table.vector("hammer.v", "_mps", [](const Source& s) { return s.marker_velocity_mps; });
  table.vector("hammer.root_v", "_mps", [](const Source& s) { return s.hammer.velocity_mps(); });
  table.vector("hammer.face_", "",
               [=](const Source& s) -> Vec3 { return rotation(s) * -Vec3::UnitX(); });
  table.vector("hammer.handle_", "",
               [=](const Source& s) -> Vec3 { return rotation(s) * Vec3::UnitY(); });
  table.number("hammer.strike_mps",
               [](const Source& s) { return s.round.strikeSpeed_mps(s.hammer.velocity_mps()); });
  table.number("hammer.depth_m", [](const Source& s) {
    return (s.marker_m - s.area.position()).dot(s.area.forward());
  });
  for (std::size_t i = 0; i < kCells; ++i) {
    addTarget(table, "cell" + std::to_string(i) + ".", [i](const Source& s) { return s.cells[i]; });
  }
  for (std::size_t i = 0; i < Privileged::kNext; ++i) {
    addTarget(table, "next" + std::to_string(i) + ".", [i](const Source& s) { return s.next[i]; });
  }
  addTarget(table, "nearest.", [](const Source& s) { return s.nearest; });
  table.number("aid.progress_m", [](const Source& s) { return s.progress_m; });
  table.number("aid.strike", [](const Source& s) { return s.strike; });
  table.number("aid.start_distance_m", [](const Source& s) { return s.start_distance_m; });
  table.number("aid.start_cell", [](const Source& s) { return s.start_cell; });
  table.vector("aid.home_", "_m", [](const Source& s) -> Vec3 {
    return s.area.transformPoint(Vec3(0.0, 0.0, -Privileged::kStrokeStart_m)) - s.marker_m;
  });
  return table;
}

const Table& table() {
  static const Table table = makeTable();
  return table;
}

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

const std::vector<std::string>& Privileged::names() { return table().names(); }

void Privileged::look() {
  const auto& camera = *camera_->getComponent<render::Camera>();
  camera_->scene().forEach<Target>([&](const Target& target) {
    int& seen_id = seen_ids_[static_cast<std::size_t>(target.cell())];
    if (seen_id == target.id() || hasEnded(target)) return;
    if (rl::inView(camera, aspect_, target.hitCenter_m())) seen_id = target.id();
  });
  addToAids();
}

void Privileged::addToAids() {
  const Vec3 marker = round_->hammer().markerPosition();
  const double dt_s = camera_->scene().clock().deltaTime();
  if (has_marker_) {
    if (dt_s > 0.0) marker_velocity_mps_ = (marker - marker_m_) / dt_s;
    std::vector<const Target*> alive = shown();
    std::erase_if(alive, [](const Target* t) { return t->state() != Target::State::kAlive; });
    if (const Target* aim = firstAlive(alive)) {
      const Vec3 there = aim->hitCenter_m();
      progress_sum_m_ += (there - marker_m_).norm() - (there - marker).norm();
    }
    if (const Target* aim = nearest(alive, marker)) {
      const double speed_mps = round_->strikeSpeed_mps(round_->hammer().velocity_mps());
      const double reach = (aim->hitCenter_m() - marker).norm() / kStrikeReach_m;
      strike_sum_ += std::clamp(speed_mps, 0.0, 1.0) * std::exp(-reach * reach) * dt_s;
    }
  }
  marker_m_ = marker;
  has_marker_ = true;
}

std::vector<const Target*> Privileged::shown() const {
  std::vector<const Target*> targets;
  camera_->scene().forEach<Target>([&](const Target& target) {
    if (hasEnded(target)) return;
    if (seen_ids_[static_cast<std::size_t>(target.cell())] == target.id()) {
      targets.push_back(&target);
    }
  });
  std::sort(targets.begin(), targets.end(), [](const Target* a, const Target* b) {
    return a->expiry_s() == b->expiry_s() ? a->id() < b->id() : a->expiry_s() < b->expiry_s();
  });
  return targets;
}

void Privileged::fill(std::span<float> values) const {
  const Hammer& hammer = round_->hammer();
  Source source{.round = *round_,
                .hammer = hammer,
                .marker_m = hammer.markerPosition(),
                .marker_velocity_mps = marker_velocity_mps_,
                .head_m = camera_->transform().position(),
                .area = area_->transform(),
                .now_s = camera_->scene().clock().time(),
                .progress_m = progress_sum_m_,
                .strike = strike_sum_};
  // The targets of a finished round are about to vanish.
  if (round_->phase() != Round::Phase::kDone) {
    const std::vector<const Target*> targets = shown();
    for (const Target* target : targets) {
      const Target*& cell = source.cells[static_cast<std::size_t>(target->cell())];
      if (cell == nullptr) cell = target;
    }
    std::copy_n(targets.begin(), std::min(targets.size(), source.next.size()), source.next.begin());
    source.nearest = nearest(targets, source.marker_m);
  }
  for (int cell = 0; cell < kCells; ++cell) {
    const Vec3 center_m = cellCenter_m(cell, round_->settings());
    const Vec3 start_m = source.area.transformPoint(center_m - Vec3(0.0, 0.0, kStrokeStart_m));
    const double distance_m = (start_m - source.marker_m).norm();
    if (distance_m < source.start_distance_m) {
      source.start_distance_m = distance_m;
      source.start_cell = cell;
    }
  }
  table().fill(source, values);
}

void Privileged::fields(Archive& archive) {
  archive.field("seen_ids", seen_ids_, {-1.0, kCounts.high});
  archive.field("has_marker", has_marker_);
  archive.field("marker", marker_m_);
  archive.field("marker_velocity", marker_velocity_mps_);
  archive.field("progress_sum", progress_sum_m_, kQuantities);
  archive.field("strike_sum", strike_sum_, kQuantities);
}

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

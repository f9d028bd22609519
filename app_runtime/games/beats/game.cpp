// SPDX-License-Identifier: Apache-2.0
#include "beats/game.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "beats/level.hpp"
#include "beats/stage.hpp"
#include "beats/swing.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/render/mesh.hpp"
#include "sim2vr/rl/privileged_table.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::beats {
namespace {

// What the table's getters read: of what comes only what the head camera has shown. Nothing comes
// any more when a round is over.
struct Source {
  Source(const Round& the_round, const Sight& the_sight)
      : round(the_round),
        sight(the_sight),
        over(round.phase() == Round::Phase::kDone),
        head_m(round.head().transform().position()) {
    if (over) return;
    boxes = {sight.boxes(Hand::kLeft), sight.boxes(Hand::kRight)};
    mines = sight.mines();
    walls = sight.walls();
  }

  const Round& round;
  const Sight& sight;
  bool over;
  Vec3 head_m;
  std::array<std::vector<std::size_t>, 2> boxes;  // by hand
  std::vector<std::size_t> mines, walls;
};

using Table = rl::PrivilegedTable<Source>;

void addSaber(Table& table, Hand hand) {
  const std::string prefix = hand == Hand::kLeft ? "left." : "right.";
  // Without a held saber all of its numbers are 0.
  const auto add = [&](const std::string& name, const std::string& unit, auto value) {
    table.vector(prefix + name, unit, [=](const Source& s) {
      const Saber& saber = s.round.saber(hand);
      return saber.held() ? Vec3(value(s, saber)) : Vec3(Vec3::Zero());
    });
  };
  add("root_", "_m", [](const Source& s, const Saber& saber) -> Vec3 {
    return saber.segment().root_m - s.head_m;
  });
  add("axis_", "", [](const Source&, const Saber& saber) -> Vec3 {
    const Segment blade = saber.segment();
    return (blade.tip_m - blade.root_m).normalized();
  });
  add("tip_v", "_mps", [](const Source&, const Saber& saber) { return saber.tipVelocity_mps(); });
  table.number(prefix + "on", [=](const Source& s) { return s.round.saber(hand).held(); });
}

void addBox(Table& table, Hand hand, std::size_t i) {
  const std::string prefix = (hand == Hand::kLeft ? "left" : "right") + std::to_string(i) + ".";
  const auto index = [=](const Source& s) -> std::optional<std::size_t> {
    const auto& boxes = s.boxes[static_cast<std::size_t>(hand)];
    return i < boxes.size() ? std::optional(boxes[i]) : std::nullopt;
  };
  table.number(prefix + "present", [=](const Source& s) { return index(s).has_value(); });
  table.number(prefix + "time_s", [=](const Source& s) {
    const auto box = index(s);
    return box ? s.round.level().boxes[*box].time_s - s.round.time_s() : 0.0;
  });
  table.vector(prefix, "_m", [=](const Source& s) {
    const auto box = index(s);
    return box ? Vec3(s.round.box(*box).center_m - s.head_m) : Vec3(Vec3::Zero());
  });
  for (int axis = 0; axis < 2; ++axis) {
    table.number(prefix + "dir_" + "xy"[axis], [=](const Source& s) {
      const auto box = index(s);
      return box ? cutVector(s.round.level().boxes[*box])[axis] : 0.0;
    });
  }
}

void addMine(Table& table, std::size_t i) {
  const std::string prefix = "mine" + std::to_string(i) + ".";
  table.number(prefix + "present", [=](const Source& s) { return i < s.mines.size(); });
  table.number(prefix + "time_s", [=](const Source& s) {
    return i < s.mines.size() ? s.round.level().mines[s.mines[i]].time_s - s.round.time_s() : 0.0;
  });
  table.vector(prefix, "_m", [=](const Source& s) {
    return i < s.mines.size() ? Vec3(s.round.mine(s.mines[i]).center_m - s.head_m)
                              : Vec3(Vec3::Zero());
  });
}

void addWall(Table& table, std::size_t i) {
  const std::string prefix = "wall" + std::to_string(i) + ".";
  table.number(prefix + "present", [=](const Source& s) { return i < s.walls.size(); });
  const auto add = [&](const std::string& name, auto value) {
    table.number(prefix + name, [=](const Source& s) {
      return i < s.walls.size() ? value(s, s.round.wall(s.walls[i])) : 0.0;
    });
  };
  for (const double side : {-1.0, 1.0}) {
    add(side < 0.0 ? "start_s" : "end_s", [=](const Source& s, const Block& wall) {
      const double ahead_m = wall.center_m.z() - s.round.origin_m().z();
      return (ahead_m + side * wall.half_m.z()) / s.round.level().speed_mps;
    });
  }
  constexpr std::array kSides{"left_m", "right_m", "bottom_m", "top_m"};
  for (int i_side = 0; i_side < 4; ++i_side) {
    const int axis = i_side / 2;
    const double side = i_side % 2 == 0 ? -1.0 : 1.0;
    add(kSides[static_cast<std::size_t>(i_side)], [=](const Source& s, const Block& wall) {
      return wall.center_m[axis] + side * wall.half_m[axis] - s.head_m[axis];
    });
  }
}

// Of the head's sphere in the cross section, seen from the front; negative outside.
double depthInWall_m(const Source& s) {
  if (s.walls.empty()) return 0.0;
  const Block wall = s.round.wall(s.walls.front());
  const Vec3 outside = (s.head_m - wall.center_m).cwiseAbs() - wall.half_m;
  return s.round.layout().head_radius_m - std::max(outside.x(), outside.y());
}

Table makeTable() {
  Table table;
  table.vector("head.", "_m",
               [](const Source& s) -> Vec3 { return s.head_m - s.round.origin_m(); });
  for (const Hand hand : {Hand::kLeft, Hand::kRight}) addSaber(table, hand);
  for (const Hand hand : {Hand::kLeft, Hand::kRight}) {
    for (std::size_t i = 0; i < kShownBoxes; ++i) addBox(table, hand, i);
  }
  for (std::size_t i = 0; i < kShownMines; ++i) addMine(table, i);
  for (std::size_t i = 0; i < kShownWalls; ++i) addWall(table, i);
  table.number("round.speed_mps", [](const Source& s) { return s.round.level().speed_mps; });
  for (const Hand hand : {Hand::kLeft, Hand::kRight}) {
    table.number(hand == Hand::kLeft ? "aid.left_m" : "aid.right_m", [=](const Source& s) {
      return s.over ? 0.0 : s.sight.bladeToBox_m(hand).value_or(0.0);
    });
  }
  table.number("aid.wall_m", depthInWall_m);
  table.number("aid.score", [](const Source& s) { return s.round.tally().score(); });
  table.number("aid.misses", [](const Source& s) { return s.round.tally().misses(); });
  table.number("aid.errors", [](const Source& s) { return s.round.tally().errors(); });
  table.number("aid.slices", [](const Source& s) { return s.round.tally().slices(); });
  return table;
}

const Table& table() {
  static const Table table = makeTable();
  return table;
}

// A box is worth approaching for so long before it reaches the cut plane, and afterwards.
constexpr double kApproach_s = 1.0;
constexpr double kApproachRate_per_m = 4.0;

constexpr double kHandleRadius_m = 0.016;
constexpr double kHandleEnd_m = -0.08;
constexpr double kHandleTop_m = 0.08;

render::MeshPtr ringMesh() {
  static const std::array<render::LathePoint, 3> outline{
      {{0.030, -0.008}, {0.036, 0.0}, {0.030, 0.008}}};
  static const render::MeshPtr mesh = render::lathe(outline, 10, "saber ring");
  return mesh;
}

// Made around y, shown around z.
scene::Transform& addPart(scene::GameObject& controller, const std::string& name,
                          const render::MeshPtr& mesh, const render::Material& material) {
  scene::GameObject& part = controller.scene().create(name, &controller);
  part.addComponent<render::MeshRenderer>(mesh, material);
  part.transform().setLocalRotation(rotationBetween(Vec3::UnitY(), Vec3::UnitZ()));
  return part.transform();
}

void addRod(scene::GameObject& controller, const std::string& name, double from_m, double to_m,
            double radius_m, const render::Material& material) {
  scene::Transform& rod = addPart(controller, name, render::cylinder(8), material);
  rod.setLocalPosition({0.0, 0.0, (from_m + to_m) / 2.0});
  rod.setLocalScale({radius_m, to_m - from_m, radius_m});
}

/// A short handle, a ring and a thin straight blade along the controller's +z.
void addSaberLooks(scene::GameObject& controller, Hand hand, const Rod& blade) {
  const render::Color& color = colorOf(hand);
  const render::Color dim{color.r * 0.5F, color.g * 0.5F, color.b * 0.5F, 1.0F};
  addRod(controller, "Handle", kHandleEnd_m, kHandleTop_m, kHandleRadius_m,
         render::unlitMaterial(dim));
  addRod(controller, "Blade", blade.root_m, blade.tip_m, kBladeRadius_m,
         render::unlitMaterial(color));
  render::Material both_sides = render::unlitMaterial(color);
  both_sides.cull_back = false;
  addPart(controller, "Ring", ringMesh(), both_sides).setLocalPosition({0.0, 0.0, kHandleTop_m});
}

}  // namespace

const std::vector<std::string>& privilegedNames() { return table().names(); }

void writePrivileged(const Round& round, const Sight& sight, std::span<float> values) {
  table().fill(Source(round, sight), values);
}

void Env::declareLog() {
  logTerm("ApproachReward", [this] { return approach_; });
  logTerm("PenaltyReward", [this] { return penalty_; });
  const Tally& tally = round_.tally();
  const auto boxes = static_cast<double>(round_.level().boxes.size());
  logColumn("Boxes", [boxes] { return boxes; });
  logColumn("Score", [&] { return tally.score(); });
  logColumn("AccumulatedCorrectSlices", [&] { return tally.slices(); });
  logColumn("AccumulatedErrors", [&] { return tally.errors(); });
  logColumn("BoxesNotSliced", [&tally, boxes] { return boxes - tally.slices(); });
  logColumn("Misses", [&] { return tally.misses(); });
  logColumn("WrongHand", [&] { return tally.count(Fault::kWrongHand); });
  logColumn("WrongDirection", [&] { return tally.count(Fault::kWrongDirection); });
  logColumn("MineHits", [&] { return tally.count(Fault::kMine); });
  logColumn("MinesAvoided", [&] { return tally.minesAvoided(); });
  logColumn("WallHits", [&] { return tally.count(Fault::kWall); });
  logColumn("WallsAvoided", [&] { return tally.wallsAvoided(); });
  logColumn("WallSeconds", [&] { return tally.wall_s(); });
  logColumn("Combo", [&] { return tally.combo(); });
  logColumn("MaxCombo", [&] { return tally.longestCombo(); });
  logColumn("Multiplier", [&] { return tally.factor(); });
  logColumn("Energy",
            [&, energy = round_.settings().energy] { return energy ? tally.energy() : 1.0; });
  logColumn("CutSpeed", [&] { return tally.meanSpeed_mps(); });
  logColumn("CutAngleError", [&] { return tally.meanAngle_deg(); });
  const Saber& left = round_.saber(Hand::kLeft);
  const Saber& right = round_.saber(Hand::kRight);
  logColumn("HandTravelLeft", [&] { return left.travel_m(); });
  logColumn("HandTravelRight", [&] { return right.travel_m(); });
  logColumn("HandTravel", [&] { return left.travel_m() + right.travel_m(); });
}

double Env::calculateReward() {
  sight_.look();
  const Tally& tally = round_.tally();
  const Settings& settings = round_.settings();
  double reward = tally.score() - score_;
  if (settings.shaped) {
    approach_ = round_.phase() == Round::Phase::kPlay ? approachReward() : 0.0;
    penalty_ = -settings.miss_penalty * (tally.misses() - misses_) -
               settings.error_penalty * (tally.errors() - errors_);
    reward += approach_ + penalty_;
  }
  score_ = tally.score();
  misses_ = tally.misses();
  errors_ = tally.errors();
  return reward;
}

double Env::approachReward() const {
  double sum = 0.0;
  for (const Hand hand : {Hand::kLeft, Hand::kRight}) {
    const std::vector<std::size_t> next = sight_.boxes(hand);
    if (next.empty()) continue;
    const Box& box = round_.level().boxes[next.front()];
    const auto distance_m = sight_.bladeToBox_m(hand);
    if (!distance_m || box.time_s - round_.time_s() > kApproach_s) continue;
    sum += std::exp(-kApproachRate_per_m * *distance_m);
  }
  return round_.settings().approach_reward * round_.frame_s() * sum;
}

float Env::timeFeature() const {
  if (!round_.settings().time_feature) return 0.0F;
  const double lead_in_s = round_.settings().lead_in_s;
  const double share =
      (round_.time_s() + lead_in_s) / std::max(round_.level().length_s + lead_in_s, 1e-9);
  return static_cast<float>(std::clamp(2.0 * share - 1.0, -1.0, 1.0));
}

void Env::fillPrivileged(std::span<float> values) const { writePrivileged(round_, sight_, values); }

void Env::fields(Archive& archive) {
  RLEnv::fields(archive);
  archive.field("sight", sight_);
  archive.field("score", score_, kCounts);
  archive.field("misses", misses_, kCounts);
  archive.field("errors", errors_, kQuantities);
}

rl::RLEnv& Beats::build(rl::GameContext& context) {
  return buildRound(context, settings_,
                    std::make_shared<const Level>(makeLevel(settings_.level, context.seed)));
}

rl::RLEnv& buildRound(rl::GameContext& context, const Settings& settings,
                      std::shared_ptr<const Level> level) {
  // The game's own actions are made before the rig attaches them.
  const Feedback feedback(context.xr, context.sounds);
  RoundSetup setup;
  setup.settings = settings;
  setup.level = std::move(level);
  setup.rig = rl::buildXrRig(context);
  setup.seed = context.seed;
  setup.logger = context.logger;
  const Rod blade = bladeOf(settings.layout);
  addSaberLooks(*setup.rig.left_controller, Hand::kLeft, blade);
  addSaberLooks(*setup.rig.right_controller, Hand::kRight, blade);

  scene::Scene& scene = context.scene;
  auto& round = scene.create("Round").addComponent<Round>(setup, feedback);
  scene.create("Stage").addComponent<Stage>(round);
  return scene.create("RL Environment").addComponent<Env>(round, context.xr.settings().aspect);
}

const std::vector<std::string>& Beats::privilegedNames() const { return beats::privilegedNames(); }

std::string Beats::timelineJson(std::uint32_t seed) const {
  return beats::timelineJson(makeLevel(settings_.level, seed));
}

namespace {

std::vector<rl::Measure> countedMeasures() {
  return {
      {.name = "correct_slices",
       .label = "Correct slices",
       .log_key = "AccumulatedCorrectSlices",
       .digits = 2},
      {.name = "boxes",
       .label = "Boxes",
       .log_key = "Boxes",
       .better = rl::Better::kNone,
       .description = "In the level, whether the round lasted until they came or not"},
      {.name = "slice_rate",
       .label = "Slice rate",
       .log_key = "AccumulatedCorrectSlices",
       .digits = 3,
       .description = "Correct slices / boxes of the level, from 0 to 1",
       .rate_with = "BoxesNotSliced"},
      {.name = "errors",
       .label = "Errors",
       .log_key = "AccumulatedErrors",
       .better = rl::Better::kLower,
       .description = "Wrong hand, wrong direction, mines, walls"},
      {.name = "score", .label = "Score", .log_key = "Score", .digits = 0},
      {.name = "misses",
       .label = "Misses",
       .log_key = "Misses",
       .better = rl::Better::kLower,
       .description = "Boxes that went by uncut"},
      {.name = "wrong_hand",
       .label = "Wrong hand",
       .log_key = "WrongHand",
       .better = rl::Better::kLower},
      {.name = "wrong_direction",
       .label = "Wrong direction",
       .log_key = "WrongDirection",
       .better = rl::Better::kLower},
      {.name = "max_combo",
       .label = "Longest combo",
       .log_key = "MaxCombo",
       .description = "Correct slices in a row"},
  };
}

std::vector<rl::Measure> dodgedMeasures() {
  return {
      {.name = "mine_rate",
       .label = "Mines touched",
       .log_key = "MineHits",
       .better = rl::Better::kLower,
       .digits = 3,
       .description = "Share of the mines that came by",
       .rate_with = "MinesAvoided"},
      {.name = "wall_rate",
       .label = "Walls touched",
       .log_key = "WallHits",
       .better = rl::Better::kLower,
       .digits = 3,
       .description = "Share of the walls that the head was in",
       .rate_with = "WallsAvoided"},
      {.name = "wall_seconds",
       .label = "Time in walls",
       .unit = "s",
       .log_key = "WallSeconds",
       .better = rl::Better::kLower,
       .digits = 2},
  };
}

std::vector<rl::Measure> movementMeasures() {
  return {
      {.name = "cut_speed_mps",
       .label = "Cut speed",
       .unit = "m/s",
       .log_key = "CutSpeed",
       .better = rl::Better::kNone,
       .digits = 2,
       .description = "Of the blade at the box, mean over correct slices",
       .only_if = "AccumulatedCorrectSlices"},
      {.name = "cut_angle_deg",
       .label = "Cut angle error",
       .unit = "deg",
       .log_key = "CutAngleError",
       .better = rl::Better::kLower,
       .description = "From the demanded direction, mean over correct slices",
       .only_if = "AccumulatedCorrectSlices"},
      {.name = "hand_travel_m",
       .label = "Hand travel",
       .unit = "m",
       .log_key = "HandTravel",
       .better = rl::Better::kNone,
       .description = "Way of both grips"},
      {.name = "hand_travel_left_m",
       .label = "Hand travel, left",
       .unit = "m",
       .log_key = "HandTravelLeft",
       .better = rl::Better::kNone},
      {.name = "hand_travel_right_m",
       .label = "Hand travel, right",
       .unit = "m",
       .log_key = "HandTravelRight",
       .better = rl::Better::kNone},
  };
}

std::vector<rl::LoggedItem> loggedItems() {
  const auto item = [](const std::string& name, std::vector<rl::LoggedItem::Outcome> outcomes) {
    return rl::LoggedItem{.name = name,
                          .id_field = "number",
                          .begin_event = name + "_spawn",
                          .outcomes = std::move(outcomes),
                          .place_field = "place",
                          .velocity_field = "velocity"};
  };
  return {item("box", {{"box_slice", "slice", true},
                       {"box_wrong_hand", "wrong hand", false},
                       {"box_wrong_direction", "wrong direction", false},
                       {"box_miss", "miss", false}}),
          item("mine", {{"mine_hit", "hit", false}, {"mine_avoided", "avoided", true}}),
          item("wall", {{"wall_hit", "hit", false}, {"wall_avoided", "avoided", true}})};
}

}  // namespace

// docs/reference/games/beats.md has the log's definitions.
rl::GameFacts Beats::facts() const {
  rl::GameFacts facts;
  facts.round_seconds = makeLevel({}, 0).length_s;
  facts.devices = {"controller_left", "controller_right"};
  for (const auto& group : {countedMeasures(), dodgedMeasures(), movementMeasures()}) {
    facts.measures.insert(facts.measures.end(), group.begin(), group.end());
  }
  facts.score = "slice_rate";
  facts.reward_terms = {{"ApproachReward", "blade closeness"},
                        {"PenaltyReward", "misses and errors"}};
  facts.reward_rest = "score";
  facts.items = loggedItems();
  facts.conditions = {
      {.name = "first",
       .description = "Ten seconds with four boxes; a missed one ends the round",
       .options_json = R"({"level": "first", "end_on_miss": true})",
       .evaluated = true},
      {.name = "level",
       .description = "A generated level, another for each seed, with mines and walls",
       .options_json = R"({"level": "generated", "end_on_miss": false})",
       .evaluated = true},
      {.name = "full",
       .description = "The built-in level of 60 s with mines and walls",
       .options_json = R"({"level": "full", "end_on_miss": false})",
       .evaluated = true},
  };
  facts.default_condition = "first";
  facts.level_option = "level";
  return facts;
}

}  // namespace sim2vr::games::beats

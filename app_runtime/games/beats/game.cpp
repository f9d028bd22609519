// SPDX-License-Identifier: Apache-2.0
#include "beats/game.hpp"

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "beats/colors.hpp"
#include "beats/env.hpp"
#include "beats/level.hpp"
#include "beats/level_timeline.hpp"
#include "beats/privileged.hpp"
#include "beats/saber.hpp"
#include "beats/stage.hpp"
#include "beats/sweep.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/render/mesh.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::beats {
namespace {

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
  part.transform().setLocalRotation(Quat::FromTwoVectors(Vec3::UnitY(), Vec3::UnitZ()));
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

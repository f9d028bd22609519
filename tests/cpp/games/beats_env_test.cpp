// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "beats/game.hpp"
#include "beats/stage.hpp"
#include "beats_player.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/render/components.hpp"

namespace sim2vr::games::beats {
namespace {

std::map<std::string, float> privileged(BeatsRound& round) {
  const std::vector<std::string>& names = round.game.privilegedNames();
  std::vector<float> values(names.size());
  round.harness.env().fillPrivileged(values);
  std::map<std::string, float> named;
  for (std::size_t i = 0; i < names.size(); ++i) named[names[i]] = values[i];
  EXPECT_EQ(named.size(), names.size()) << "a name came up twice";
  return named;
}

Level busyLevel() {
  Level level = emptyLevel();
  level.approach_s = 8.0;
  level.boxes = {{1.0, 1.0, 2.0, Hand::kLeft, CutDirection::kRight},
                 {1.5, 2.0, 1.0, Hand::kRight, CutDirection::kDown},
                 {2.0, 3.0, 0.0, Hand::kRight, CutDirection::kAny},
                 {7.0, 2.0, 1.0, Hand::kRight, CutDirection::kUp}};
  level.mines = {{3.0, 0.0, 0.0}};
  level.walls = {{2.0, 1.0, 0.0, 0.0, 2.0, 3.0}};
  return level;
}

TEST(BeatsPrivileged, TellsWhatComesRelativeToTheHead) {
  BeatsRound round(busyLevel());
  round.frame({});
  Stance stance;
  stance.head = {0.1, 1.1, 0.0};
  stance.right.position = {0.2, 0.9, 0.0};
  round.frame(stance);
  auto timed = privileged(round);
  EXPECT_NEAR(timed["head.x_m"], 0.1, 1e-6);
  EXPECT_NEAR(timed["head.y_m"], -0.1, 1e-6);
  // Column 1, row 2: x = -0.2, y = 0.05 from the origin; z = 0.8 + 2 (1 - 0.05).
  EXPECT_EQ(timed["left0.present"], 1.0F);
  EXPECT_NEAR(timed["left0.time_s"], 0.95, 1e-6);
  EXPECT_NEAR(timed["left0.x_m"], -0.3, 1e-6);
  EXPECT_NEAR(timed["left0.y_m"], 0.15, 1e-6);
  EXPECT_NEAR(timed["left0.z_m"], 2.7, 1e-6);
  EXPECT_NEAR(timed["left0.dir_x"], 1.0, 1e-6);
  EXPECT_NEAR(timed["left0.dir_y"], 0.0, 1e-6);
  EXPECT_EQ(timed["left1.present"], 0.0F);
  EXPECT_NEAR(timed["right0.dir_y"], -1.0, 1e-6);
  EXPECT_EQ(timed["right1.present"], 1.0F);
  EXPECT_EQ(timed["right1.dir_x"], 0.0F);
  EXPECT_EQ(timed["right1.dir_y"], 0.0F);
  EXPECT_EQ(timed["mine0.present"], 1.0F);
  EXPECT_NEAR(timed["mine0.y_m"], -0.65 + 0.1, 1e-6);
  // From x = -0.8 to 0, y = -0.825 to 0.225; 0.1 m to the right of it, so free by 2 cm.
  EXPECT_NEAR(timed["wall0.start_s"], 1.95, 1e-5);
  EXPECT_NEAR(timed["wall0.end_s"], 2.95, 1e-5);
  EXPECT_NEAR(timed["wall0.left_m"], -0.9, 1e-6);
  EXPECT_NEAR(timed["wall0.right_m"], -0.1, 1e-6);
  EXPECT_NEAR(timed["wall0.bottom_m"], -0.725, 1e-6);
  EXPECT_NEAR(timed["wall0.top_m"], 0.325, 1e-6);
  EXPECT_NEAR(timed["aid.wall_m"], -0.02, 1e-6);
  EXPECT_EQ(timed["round.speed_mps"], 2.0F);
  EXPECT_NEAR(timed["right.root_z_m"], 0.08, 1e-6);
  EXPECT_NEAR(timed["right.axis_z"], 1.0, 1e-6);
  EXPECT_NEAR(timed["right.tip_vx_mps"], (0.2 - 3.0) / 0.05, 1e-3);
  // Its tip at z = 1.08 + 0.015; the box's front at 0.8 + 2 * 1.45 - 0.175.
  EXPECT_NEAR(timed["aid.right_m"], 3.525 - 1.095, 1e-5);
}

// 0.8 + 2 * 7 = 14.8 m away at the start; the far plane is 10 m.
TEST(BeatsPrivileged, TellsOnlyWhatTheHeadCameraCouldShow) {
  Level level = busyLevel();
  level.boxes = {level.boxes.back()};
  BeatsRound round(level);
  round.waitUntil(2.3);
  EXPECT_EQ(round.round().boxesOut().size(), 1);
  EXPECT_EQ(privileged(round)["right0.present"], 0.0F);
  round.waitUntil(2.45);
  EXPECT_EQ(privileged(round)["right0.present"], 1.0F);
  round.waitUntil(9.95);
  EXPECT_EQ(privileged(round)["right0.present"], 0.0F) << "missed by then";
}

TEST(BeatsPrivileged, SpaceForAnotherNumberOfValuesIsAnError) {
  BeatsRound round(busyLevel());
  round.frame({});
  std::vector<float> values(3);
  EXPECT_THROW(round.harness.env().fillPrivileged(values), InvalidArgument);
}

TEST(BeatsEnv, ShapedRewardAddsClosenessAndPenalties) {
  Level level = emptyLevel();
  level.boxes = {{0.98, 2.0, 1.0, Hand::kRight, CutDirection::kDown}};
  BeatsRound round(level, R"({"end_on_miss": false, "reward": "shaped", "approach_reward": 20.0,
                              "miss_penalty": 30.0, "error_penalty": 7.0})");
  Stance beside;
  beside.right.position = {0.2 + 0.175 + 0.015 + 0.25, 0.9, 0.0};
  round.frame(beside);
  round.frame(beside);
  // The tip ends at z = 1.08, the box begins at 0.8 + 2 * 0.93 - 0.175 = 2.485.
  const double gap = std::hypot(0.25 + 0.015, 2.485 - 1.08) - 0.015;
  EXPECT_NEAR(round.harness.env().reward(), 20.0 * 0.05 * std::exp(-4.0 * gap), 1e-4);
  round.waitUntil(1.35, beside);
  const double before = round.rewardSum();
  EXPECT_NEAR(round.harness.log("ApproachRewardSum"), before, 1e-4);
  round.frame(beside);
  EXPECT_NEAR(round.harness.env().reward(), -30.0, 1e-6);
  EXPECT_EQ(round.harness.log("PenaltyRewardSum"), -30.0);
}

TEST(BeatsEnv, TimeFeatureIsConstantByDefault) {
  BeatsRound plain(emptyLevel(2.0));
  BeatsRound timed(emptyLevel(2.0), R"({"end_on_miss": false, "time_feature": true})");
  for (BeatsRound* round : {&plain, &timed}) round->waitUntil(0.5);
  EXPECT_EQ(plain.harness.env().timeFeature(), 0.0F);
  EXPECT_NEAR(timed.harness.env().timeFeature(), -0.5F, 1e-5F);
}

TEST(BeatsEnv, HandTravelIsTheWayOfBothGrips) {
  BeatsRound round(emptyLevel());
  Stance stance;
  round.frame(stance);
  stance.left.position.x() += 0.3;
  stance.right.position.y() += 0.4;
  round.frame(stance);
  stance.left.position.x() -= 0.3;
  round.frame(stance);
  EXPECT_NEAR(round.harness.log("HandTravelLeft"), 0.6, 1e-6);
  EXPECT_NEAR(round.harness.log("HandTravelRight"), 0.4, 1e-6);
  EXPECT_NEAR(round.harness.log("HandTravel"), 1.0, 1e-6);
}

TEST(BeatsOptions, WrongOnesAreNamed) {
  const auto message = [](const std::string& options_json) -> std::string {
    try {
      Options options = Options::fromJson(options_json);
      Settings::fromOptions(options);
    } catch (const InvalidArgument& error) {
      return error.what();
    }
    return "none";
  };
  EXPECT_NE(message(R"({"full_cut_speed_mps": 0.4})").find("full_cut_speed_mps"),
            std::string::npos);
  EXPECT_NE(message(R"({"reward": "scored"})").find("did you mean 'score'"), std::string::npos);
  EXPECT_NE(message(R"({"angle_limit_deg": 0})").find("angle_limit_deg"), std::string::npos);
  EXPECT_EQ(message("{}"), "none");
}

TEST(BeatsStage, ShowsWhatIsOutWhereItIs) {
  Level level = busyLevel();
  BeatsRound round(level);
  round.frame({});
  const auto shown = [&round](const std::string& name) {
    std::vector<const render::MeshRenderer*> found;
    for (const auto* renderer : round.harness.all<render::MeshRenderer>()) {
      if (renderer->visible && renderer->gameObject().name() == name) found.push_back(renderer);
    }
    return found;
  };
  const auto arrows = shown("Box");
  ASSERT_EQ(arrows.size(), 3);
  EXPECT_EQ(shown("Dot Box").size(), 1);
  EXPECT_EQ(shown("Mine").size(), 1);
  ASSERT_EQ(shown("Wall").size(), 1);
  EXPECT_TRUE(arrows[0]->transform().position().isApprox(Vec3(-0.2, 1.25, 2.8), 1e-6));
  EXPECT_GT(arrows[0]->material.albedo.r, arrows[0]->material.albedo.b);
  EXPECT_LT(arrows[1]->material.albedo.r, arrows[1]->material.albedo.b);
  EXPECT_TRUE(shown("Wall")[0]->transform().position().isApprox(Vec3(-0.4, 0.9, 5.0), 1e-6));
  round.waitUntil(7.2);
  EXPECT_EQ(shown("Box").size() + shown("Dot Box").size(), 1) << "the last has not passed";
  EXPECT_EQ(shown("Mine").size() + shown("Wall").size(), 0);
}

}  // namespace
}  // namespace sim2vr::games::beats

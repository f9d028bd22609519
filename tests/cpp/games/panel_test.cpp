// SPDX-License-Identifier: Apache-2.0
// Rounds of the panel, frame by frame. The head is at (0, 1.2, 0): the panel's centre is at
// (0, 1.1, 1.5). The ray begins at the hand, which lies 1 m before the panel.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "game_harness.hpp"
#include "panel/game.hpp"
#include "panel/round.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::panel {
namespace {

constexpr double kFloat = 1e-5;
const Pose kHead{{0.0, 1.2, 0.0}, Quat::Identity()};
const Vec3 kHand{0.0, 1.1, 0.5};
/// Of the panel, from itself.
const Vec3 kCenter = Vec3::Zero();

double closeness(double gap) { return 0.1 * (std::exp(-5.0 * gap) - 1.0); }

struct Play {
  explicit Play(const std::string& options) : harness(game, 7, options) { point(kCenter); }

  Round& round() { return *harness.scene().find("Panel")->getComponent<Round>(); }
  const Widget& widget(int index) { return *round().widgets().at(static_cast<std::size_t>(index)); }
  const Widget& lit() { return widget(round().lit()); }

  /// A frame in which the ray goes through a place on the panel, from its centre.
  void point(const Vec3& place_m, float trigger = 0.0F, double roll_rad = 0.0) {
    const Vec3 way = Vec3(0.0, 1.1, 1.5) + place_m - kHand;
    // A turn about the ray moves no point on it.
    const Quat rolled(Eigen::AngleAxisd(-roll_rad, Vec3::UnitZ()));
    frame({kHead, {kHand, lookAlong(way) * rolled}, trigger});
  }
  void pull(const Vec3& place_m) {
    point(place_m);
    point(place_m, 1.0F);
    point(place_m);
  }
  /// A frame in which the fingertip is at a place, world.
  void touch(const Vec3& place_m) {
    frame({kHead, {place_m - Vec3(0.0, 0.0, kFinger_m), Quat::Identity()}});
  }
  void frame(const testing::Poses& poses) { harness.frame(50'000'000 * frames++, poses); }
  double log(const std::string& name) { return harness.env().log().at(name); }

  Panel game;
  testing::GameHarness harness;
  int frames = 0;
};

TEST(Panel, ARayAndTheTriggerOperateTheLitButton) {
  Play play("{}");
  const Vec3 place_m = play.lit().center_m();
  play.pull(place_m);
  EXPECT_EQ(play.log("Points"), 1.0);
  EXPECT_EQ(play.log("Errors"), 0.0);
  // Three frames after it came up, in frame 0, the trigger was pulled in frame 2.
  EXPECT_NEAR(play.log("MedianSelectionTime"), 0.1, kFloat);
  EXPECT_EQ(play.harness.sounds().take().back().name, "hit");
  EXPECT_EQ(play.harness.session().takePulses().size(), 1U);
  EXPECT_FALSE(play.lit().center_m().isApprox(place_m, kFloat));
}

TEST(Panel, RewardIsTenForAHitAndGrowsAsTheRayComesNearer) {
  Play play(R"({"columns": 2, "rows": 1, "pitch_m": 1.0})");
  const double x_m = play.lit().center_m().x();
  EXPECT_NEAR(std::abs(x_m), 0.5, kFloat);
  // Straight ahead of the hand, 1 m away; the button lies 0.5 m beside.
  play.point(kCenter);
  EXPECT_NEAR(play.harness.env().reward(), closeness(std::atan(0.5)), kFloat);
  play.point({x_m, 0.0, 0.0});
  EXPECT_NEAR(play.harness.env().reward(), 0.0, kFloat);
  play.point({x_m, 0.0, 0.0}, 1.0F);
  // The other button is lit now, as far on the other side.
  EXPECT_NEAR(play.harness.env().reward(), 10.0 + closeness(2.0 * std::atan(0.5)), kFloat);
  play.point({x_m, 0.0, 0.0});
  play.point({x_m, 0.0, 0.0}, 1.0F);
  EXPECT_NEAR(play.harness.env().reward(), -2.0 + closeness(2.0 * std::atan(0.5)), kFloat);
}

TEST(Panel, OnlyTheFirstErrorOfATargetCountsForTheErrorRate) {
  Play play(R"({"columns": 2, "rows": 1})");
  const Vec3 lit_m = play.lit().center_m();
  play.pull(-lit_m);
  play.pull({0.0, 0.5, 0.0});  // beside everything
  EXPECT_EQ(play.log("Errors"), 2.0);
  EXPECT_EQ(play.log("MissedFirst"), 0.0);  // the target is still up
  play.pull(lit_m);
  EXPECT_EQ(play.log("MissedFirst"), 1.0);
  EXPECT_EQ(play.log("HitFirst"), 0.0);
  play.pull(-lit_m);
  EXPECT_EQ(play.log("Points"), 2.0);
  EXPECT_EQ(play.log("HitFirst"), 1.0);
}

TEST(Panel, TheEdgeOfAButtonDecides) {
  Play play(R"({"columns": 1, "rows": 1, "button_m": 0.1})");
  play.pull({0.0505, 0.0, 0.0});
  EXPECT_EQ(play.log("Errors"), 1.0);
  play.pull({0.0495, 0.0, 0.0});
  EXPECT_EQ(play.log("Points"), 1.0);
}

TEST(Panel, ATargetGoesAwayAndTheRoundEnds) {
  Play play(R"({"timeout_seconds": 0.5, "round_seconds": 1.2})");
  while (!play.harness.env().finished()) play.point(kCenter);
  EXPECT_EQ(play.frames, 25);  // frames 0 to 24
  EXPECT_EQ(play.log("Timeouts"), 2.0);
}

TEST(Panel, AFingertipTouchesFromTheFrontOnly) {
  Play play(R"({"select": "touch", "columns": 1, "rows": 1})");
  const double z_m = 0.45;
  play.touch({0.0, 1.1, z_m - 0.05});
  play.touch({0.0, 1.1, z_m + 0.01});
  EXPECT_EQ(play.log("Points"), 1.0);
  play.touch({0.0, 1.1, z_m + 0.02});
  EXPECT_EQ(play.log("Points"), 1.0);
  // Round the panel and through it from behind.
  play.touch({0.0, 1.1, z_m + 0.3});
  play.touch({0.0, 1.1, z_m + 0.01});
  EXPECT_EQ(play.log("Points"), 1.0);
  play.touch({0.0, 1.1, z_m - 0.01});
  play.touch({0.0, 1.1, z_m + 0.01});
  EXPECT_EQ(play.log("Points"), 2.0);
}

TEST(Panel, ASliderIsDraggedByItsKnobAndDecidesWhenLetGo) {
  Play play(R"({"widgets": "sliders"})");
  const int index = play.round().lit();
  const Vec3 center_m = play.lit().center_m();
  // 60 cm long: its knob goes from -30 to 30 cm. Somewhere between, every 2.5 cm, is the goal, 7.2
  // cm wide.
  play.point(center_m);
  for (int k = 0; k <= 24 && play.log("Points") == 0.0; ++k) {
    play.point(play.widget(index).handle_m());
    play.point(play.widget(index).handle_m(), 1.0F);
    const Vec3 place_m = center_m + Vec3(-0.3 + 0.025 * k, 0.0, 0.0);
    play.point(place_m, 1.0F);
    EXPECT_NEAR(play.widget(index).handle_m().x(), place_m.x(), 1e-4);
    play.point(place_m);
  }
  EXPECT_EQ(play.log("Points"), 1.0);
  // Beside the knob nothing is dragged, and nothing is wrong.
  const double errors = play.log("Errors");
  const Vec3 knob_m = play.widget(index).handle_m();
  const double away_m = knob_m.x() > 0.0 ? -0.2 : 0.2;
  play.point(knob_m + Vec3(away_m, 0.0, 0.0));
  play.point(knob_m + Vec3(away_m, 0.0, 0.0), 1.0F);
  play.point(knob_m, 1.0F);
  play.point(knob_m);
  EXPECT_TRUE(play.widget(index).handle_m().isApprox(knob_m, kFloat));
  EXPECT_EQ(play.log("Errors"), errors);
}

TEST(Panel, AWristTurnsTheDialClockwise) {
  Play play(R"({"widgets": "dial"})");
  // From 0 the first goal lies 0.4 to 0.9 rad clockwise, and counts within 0.15 rad.
  for (double roll_rad = 0.4; roll_rad < 1.0 && play.log("Points") == 0.0; roll_rad += 0.25) {
    play.point(kCenter);
    play.point(kCenter, 1.0F);
    // Each turn begins where the dial is: bring it to the next angle.
    play.point(kCenter, 1.0F, roll_rad == 0.4 ? 0.4 : 0.25);
    play.point(kCenter, 0.0F, 0.0);
  }
  EXPECT_EQ(play.log("Points"), 1.0);
  Play wrong(R"({"widgets": "dial"})");
  wrong.point(kCenter, 1.0F);
  wrong.point(kCenter, 1.0F, -0.65);
  wrong.point(kCenter, 0.0F);
  EXPECT_EQ(wrong.log("Points"), 0.0);
  EXPECT_EQ(wrong.log("Errors"), 1.0);
}

TEST(Panel, AListScrollsByDraggingAndARowIsPressed) {
  Play play(R"({"widgets": "list"})");
  // Rows of 12 cm, five of twelve in the window: drags of 40 cm until the lit row is inside, where
  // its handle stays in a row's middle away from the window's ends.
  for (int drag = 0; drag < 6 && play.log("Points") == 0.0; ++drag) {
    play.pull(play.lit().handle_m());
    if (play.log("Points") > 0.0) break;
    const double way_m = play.lit().handle_m().y() < 0.0 ? 0.2 : -0.2;
    play.point({0.0, -way_m, 0.0});
    play.point({0.0, -way_m, 0.0}, 1.0F);
    play.point({0.0, way_m, 0.0}, 1.0F);
    play.point({0.0, way_m, 0.0});
  }
  EXPECT_EQ(play.log("Points"), 1.0);
}

TEST(Panel, ButtonsLookAsLargeAtEveryDistance) {
  Play play(R"({"distance_m": 3.0})");
  EXPECT_NEAR(play.lit().width_m(), 0.24, kFloat);
}

TEST(Panel, RefusesButtonsThatOverlap) {
  Panel game;
  Options options = Options::fromJson(R"({"button_m": 0.3})");
  try {
    game.configure(options);
    FAIL();
  } catch (const InvalidArgument& error) {
    EXPECT_TRUE(std::string(error.what()).starts_with("option 'pitch_m': got 0.2"));
  }
}

}  // namespace
}  // namespace sim2vr::games::panel

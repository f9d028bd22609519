// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "game_harness.hpp"
#include "sim2vr/games/registry.hpp"

namespace sim2vr::games {
namespace {

const Pose kHead{Vec3(0.0, 1.2, 0.0), Quat::Identity()};
const Pose kAway{Vec3(0.0, 0.3, -0.5), Quat::Identity()};

Vec3 ballPosition(testing::GameHarness& round) {
  return round.scene().find("Ball")->transform().position();
}

TEST(TouchTheBall, TouchScoresAndMovesTheBall) {
  const auto game = createGame("sample");
  testing::GameHarness round(*game, 1);
  round.frame(0, {kHead, kAway});
  const Vec3 first = ballPosition(round);
  round.frame(50'000'000, {kHead, {first, Quat::Identity()}});
  EXPECT_EQ(round.log("Points"), 0.0);
  round.frame(100'000'000, {kHead, {first, Quat::Identity()}});
  EXPECT_EQ(round.log("Points"), 1.0);
  const Vec3 second = ballPosition(round);
  EXPECT_NE(first, second);
  EXPECT_NEAR(round.env().reward(), 1.0 - 0.1 * (second - first).norm(), 1e-5);
}

// A ball that came up in the hand would be touched already, and could never begin to be.
TEST(TouchTheBall, TheBallNeverComesUpInTheHand) {
  for (const auto& [radius_m, options] :
       {std::pair{0.05, R"({})"}, {0.10, R"({"ball_radius_m": 0.10})"}}) {
    const auto game = createGame("sample");
    testing::GameHarness round(*game, 1, options);
    round.frame(0, {kHead, kAway});
    for (int touch = 1; touch <= 100; ++touch) {
      const Pose hand{ballPosition(round), Quat::Identity()};
      round.frame((2 * touch - 1) * 50'000'000LL, {kHead, hand});
      round.frame(2 * touch * 50'000'000LL, {kHead, hand});
      ASSERT_EQ(round.log("Points"), touch);
      ASSERT_GT((ballPosition(round) - hand.position).norm(), radius_m + 0.03);
    }
  }
}

TEST(TouchTheBall, ATouchIsHeardAndFelt) {
  const auto game = createGame("sample");
  testing::GameHarness round(*game, 1);
  round.frame(0, {kHead, kAway});
  const Vec3 ball = ballPosition(round);
  round.frame(50'000'000, {kHead, {ball, Quat::Identity()}});
  EXPECT_TRUE(round.sounds().take().empty());
  EXPECT_TRUE(round.session().takePulses().empty());
  round.frame(100'000'000, {kHead, {ball, Quat::Identity()}});
  const auto sounds = round.sounds().take();
  ASSERT_EQ(sounds.size(), 1U);
  EXPECT_EQ(sounds[0].name, "touch");
  EXPECT_EQ(sounds[0].position_m, ball);
  EXPECT_EQ(sounds[0].gain, 1.0F);
  const auto pulses = round.session().takePulses();
  ASSERT_EQ(pulses.size(), 1U);
  EXPECT_EQ(pulses[0].hand, xr::Hand::right);
  EXPECT_EQ(pulses[0].amplitude, 0.5F);
  EXPECT_EQ(pulses[0].frequency_hz, 0.0F);
  EXPECT_EQ(pulses[0].duration_ns, 20'000'000);
}

TEST(TouchTheBall, APressOfTheTriggerMovesTheBallOnWithoutAPoint) {
  const auto game = createGame("sample");
  testing::GameHarness round(*game, 1);
  round.frame(0, {kHead, kAway});
  const Vec3 first = ballPosition(round);
  round.frame(50'000'000, {kHead, kAway, 0.25F});  // not far enough
  EXPECT_EQ(ballPosition(round), first);
  round.frame(100'000'000, {kHead, kAway, 1.0F});
  const Vec3 second = ballPosition(round);
  EXPECT_NE(second, first);
  round.frame(150'000'000, {kHead, kAway, 1.0F});  // held
  EXPECT_EQ(ballPosition(round), second);
  EXPECT_EQ(round.log("Points"), 0.0);
}

TEST(TouchTheBall, RoundEnds) {
  const auto game = createGame("sample");
  testing::GameHarness round(*game, 1, R"({"round_seconds": 1})");
  round.idle(20, {kHead, kAway});
  EXPECT_FALSE(round.env().finished());
  round.frame(1'000'000'000, {kHead, kAway});
  EXPECT_TRUE(round.env().finished());
  EXPECT_EQ(round.env().timeFeature(), 1.0F);
}

TEST(TouchTheBall, SeedsMatter) {
  const auto game = createGame("sample");
  testing::GameHarness a(*game, 1);
  testing::GameHarness b(*game, 2);
  a.idle(1, {kHead, kAway});
  b.idle(1, {kHead, kAway});
  EXPECT_NE(ballPosition(a), ballPosition(b));
}

}  // namespace
}  // namespace sim2vr::games

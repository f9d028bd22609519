// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "whacamole_player.hpp"

namespace sim2vr::games::whacamole {
namespace {

// A live target of its own with the marker 0.1 m in front of its origin: exp(-10 * 0.1) - 1 =
// -0.6321206.
float rewardAtTenCentimetres(const std::string& options_json) {
  WhacAMoleRound round(options_json);
  const Target& target = round.waitFor(Target::State::kAlive);
  round.frameWithMarker(target.transform().position() - Vec3(0, 0, 0.1));
  EXPECT_EQ(round.round().counts().hits + round.round().counts().contacts, 0);
  return round.harness.env().reward();
}

TEST(Reward, DistanceTerm) {
  EXPECT_NEAR(rewardAtTenCentimetres(R"({"condition": "easy"})"), -0.06321206F, 1e-5F);
  EXPECT_NEAR(rewardAtTenCentimetres(R"({"condition": "easy", "reward": "paper"})"), -0.6321206F,
              1e-4F);
  EXPECT_EQ(rewardAtTenCentimetres(R"({"condition": "easy", "sparse": true})"), 0.0F);
}

// The log has each term of a user step and its sum over the round; what the round has not is NaN.
TEST(Reward, TermsOfAStepAndOfTheRound) {
  WhacAMoleRound round(R"({"condition": "easy"})");
  const Target& target = round.waitFor(Target::State::kAlive);
  const double before = round.harness.log("DistanceRewardSum");
  const Vec3 marker = target.transform().position() - Vec3(0, 0, 0.1);
  for (int n = 1; n <= 3; ++n) {
    round.frameWithMarker(marker);
    EXPECT_NEAR(round.harness.log("DistanceReward"), -0.06321206, 1e-5) << n;
    EXPECT_NEAR(round.harness.log("DistanceRewardSum") - before, -0.06321206 * n, 1e-5);
  }
  WhacAMoleRound sparse(R"({"condition": "easy", "sparse": true})");
  sparse.waitFor(Target::State::kAlive);
  for (const char* name : {"DistanceReward", "DistanceRewardSum", "RewardUnsuccessfulContact",
                           "RewardUnsuccessfulContactSum"}) {
    EXPECT_TRUE(std::isnan(sparse.harness.log(name))) << name;
  }
}

TEST(Reward, DistanceTermSumsLiveTargetsOnly) {
  WhacAMoleRound round(R"({"condition": "hard"})");
  bool saw_several = false;
  for (int i = 0; i < 60; ++i) {
    const Vec3 marker(0.1, 0.9, 0.2);
    round.frameWithMarker(marker);
    double expected = 0.0;
    int live = 0;
    for (const Target* target : round.targets()) {
      if (target->state() != Target::State::kAlive) continue;
      ++live;
      expected += (std::exp(-10.0 * (target->transform().position() - marker).norm()) - 1.0) / 10.0;
    }
    saw_several = saw_several || live > 1;
    EXPECT_NEAR(round.harness.env().reward(), expected, 1e-5);
  }
  EXPECT_TRUE(saw_several);
}

// A strike over d in one frame from rest is judged as 10 d m/s (target_test.cpp).
void strike(WhacAMoleRound& round, double from_m) {
  const Target& target = round.waitFor(Target::State::kAlive);
  const Vec3 center = round.hitCenter(target);
  for (int i = 0; i < 16; ++i) round.frameWithHead(center - Vec3(0, 0, from_m));
  for (int i = 0; i < 2; ++i) round.frameWithHead(center);
}

TEST(Reward, HitGivesTen) {
  for (const char* reward : {"reference", "paper"}) {
    WhacAMoleRound round(std::string(R"({"condition": "easy", "reward": ")") + reward + "\"}");
    strike(round, 0.085);
    ASSERT_EQ(round.round().counts().hits, 1);
    // The hit target no longer counts for the distance.
    EXPECT_EQ(round.harness.env().reward(), 10.0F) << reward;
    round.idle();
    EXPECT_EQ(round.harness.env().reward(), 0.0F) << reward;
  }
}

// 2 * 0.75 / 0.8 = 1.875, plus the distance term of the marker that entered with the head.
TEST(Reward, FirstContactGivesABonusByTheReferenceAndAPenaltyByThePaper) {
  for (const auto& [kind, sign] : {std::pair{"reference", 1.0}, std::pair{"paper", -1.0}}) {
    WhacAMoleRound round(std::string(R"({"condition": "easy", "reward": ")") + kind + "\"}");
    strike(round, 0.075);
    ASSERT_EQ(round.round().counts().first_contacts, 1);
    const Vec3 offset =
        round.target().transform().position() - round.round().hammer().markerPosition();
    const double weight = sign > 0 ? 0.1 : 1.0;
    const double distance = weight * (std::exp(-10.0 * offset.norm()) - 1.0);
    EXPECT_NEAR(round.harness.env().reward(), sign * 1.875 + distance, 2e-3) << kind;
    EXPECT_NEAR(round.harness.log("RewardUnsuccessfulContact"), sign * 1.875, 2e-3) << kind;
    round.frameWithHead(round.hitCenter(round.target()));
    EXPECT_NEAR(round.harness.env().reward(), distance, 1e-4) << "only once";
    EXPECT_EQ(round.harness.log("RewardUnsuccessfulContact"), 0.0) << "of the step";
    EXPECT_NEAR(round.harness.log("RewardUnsuccessfulContactSum"), sign * 1.875, 2e-3);
  }
}

TEST(Reward, BackwardContactGivesNothing) {
  WhacAMoleRound round(R"({"condition": "easy", "sparse": false})");
  const Target& target = round.waitFor(Target::State::kAlive);
  const Vec3 center = round.hitCenter(target);
  for (int i = 0; i < 8; ++i) round.frameWithHead(center + Vec3(0, 0, 0.07));
  for (int i = 0; i < 2; ++i) round.frameWithHead(center);
  ASSERT_EQ(round.round().counts().first_contacts, 1);
  EXPECT_EQ(round.harness.log("RewardUnsuccessfulContact"), 0.0);
}

TEST(Reward, LogDictionary) {
  WhacAMoleRound round(R"({"condition": "low-easy-unconstrained"})");
  EXPECT_TRUE(round.harness.env().log().empty());
  const Target& target = round.waitFor(Target::State::kAlive);
  const int cell = target.cell();
  const Vec3 center = round.hitCenter(target);
  for (int i = 0; i < 2; ++i) round.frameWithHead(center);
  EXPECT_EQ(round.harness.log("Points"), 1.0);
  EXPECT_EQ(round.harness.log("Placement"), -1.0);
  EXPECT_EQ(round.harness.log("MaxTargets"), 1.0);
  EXPECT_EQ(round.harness.log("Constrained"), 0.0);
  EXPECT_EQ(round.harness.log("hitsTarget" + std::to_string(cell)), 1.0);
  EXPECT_EQ(round.harness.log("failrateTarget" + std::to_string(cell)), 0.0);
  EXPECT_EQ(round.harness.log("HitSpeed"), round.harness.log("HitSpeedSum"));
  EXPECT_GT(round.harness.log("HitLatency"), 0.1);
  EXPECT_LT(round.harness.log("HitLatency"), 0.3);
  round.waitFor(Target::State::kFadeIn);
  const int second = round.target().cell();
  round.waitFor(Target::State::kFadeOut);
  EXPECT_EQ(round.harness.log("Misses"), 1.0);
  EXPECT_EQ(round.harness.log("failrateTarget" + std::to_string(second)),
            second == cell ? 0.5 : 1.0);
}

// Depth is the marker behind the area's origin, averaged over the frames of play.
TEST(Reward, HammerDepth) {
  WhacAMoleRound round(R"({"condition": "low-easy"})");
  round.idle();
  const auto& area = round.harness.scene().find("Target Area")->transform();
  const Vec3 origin = area.position();
  round.frameWithMarker(origin + Vec3(0, 0, -0.10));
  EXPECT_NEAR(round.harness.log("HammerDepthZ"), -0.10, 1e-6);
  EXPECT_NEAR(round.harness.log("HammerDepthNormal"), -0.10 * std::sqrt(0.5), 1e-6);
  round.frameWithMarker(origin + Vec3(0, 0, 0.04));
  EXPECT_NEAR(round.harness.log("HammerDepthZ"), -0.03, 1e-6);
}

}  // namespace
}  // namespace sim2vr::games::whacamole

// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numbers>
#include <string>

#include "sim2vr/core/errors.hpp"
#include "whacamole/conditions.hpp"

namespace sim2vr::games::whacamole {
namespace {

TEST(Conditions, TableMatchesTheStudy) {
  const std::map<std::string, std::pair<Placement, int>> expected{
      {"easy", {Placement::kMid, 1}},       {"medium", {Placement::kMid, 3}},
      {"mid", {Placement::kMid, 3}},        {"mid-medium", {Placement::kMid, 3}},
      {"hard", {Placement::kMid, 5}},       {"low", {Placement::kLow, 3}},
      {"low-medium", {Placement::kLow, 3}}, {"low-easy", {Placement::kLow, 1}},
      {"high", {Placement::kHigh, 3}},      {"high-medium", {Placement::kHigh, 3}},
      {"high-easy", {Placement::kHigh, 1}},
  };
  for (const auto& [name, row] : expected) {
    const Condition condition = resolveCondition(name, 7);
    EXPECT_EQ(condition.name, name);
    EXPECT_EQ(condition.placement, row.first) << name;
    EXPECT_EQ(condition.max_targets, row.second) << name;
    EXPECT_TRUE(condition.constrained) << name;
    const Condition free = resolveCondition(name + "-unconstrained", 7);
    EXPECT_EQ(free.name, name + "-unconstrained");
    EXPECT_EQ(free.placement, row.first) << name;
    EXPECT_EQ(free.max_targets, row.second) << name;
    EXPECT_FALSE(free.constrained) << name;
  }
  EXPECT_EQ(conditionNames().size(), 2 * (expected.size() + 3));
}

TEST(Conditions, EveryListedNameResolves) {
  for (const std::string& name : conditionNames()) EXPECT_NO_THROW(resolveCondition(name, 1));
}

std::map<std::string, int> draw(const std::string& mix, int seeds) {
  std::map<std::string, int> counts;
  for (int seed = 0; seed < seeds; ++seed) {
    ++counts[resolveCondition(mix, static_cast<std::uint32_t>(seed)).name];
  }
  return counts;
}

TEST(Conditions, MixesDrawEveryMemberAboutEquallyOften) {
  const auto medium = draw("random", 3000);
  ASSERT_EQ(medium.size(), 3U);
  for (const char* name : {"low-medium", "medium", "high-medium"}) {
    EXPECT_NEAR(medium.at(name), 1000, 120) << name;
  }
  const auto easy = draw("random-easy-unconstrained", 3000);
  ASSERT_EQ(easy.size(), 3U);
  for (const char* name :
       {"low-easy-unconstrained", "easy-unconstrained", "high-easy-unconstrained"}) {
    EXPECT_NEAR(easy.at(name), 1000, 120) << name;
  }
  EXPECT_EQ(draw("random-easy-medium", 600).size(), 6U);
}

TEST(Conditions, MixIsFixedByTheSeed) {
  EXPECT_EQ(resolveCondition("random", 12).name, resolveCondition("random", 12).name);
}

TEST(Conditions, GeometryTable) {
  EXPECT_EQ(geometry(Placement::kMid).offset_m, Vec3(0.15, -0.10, 0.40));
  EXPECT_EQ(geometry(Placement::kLow).offset_m, Vec3(0.15, -0.30, 0.35));
  EXPECT_EQ(geometry(Placement::kHigh).offset_m, Vec3(0.15, 0.20, 0.30));
  // Plane normal = local +z, away from the player: down for the tilted-up low area, up for the
  // high.
  const double half = std::sqrt(0.5);
  EXPECT_TRUE(
      (geometry(Placement::kLow).rotation * Vec3::UnitZ()).isApprox(Vec3(0, -half, half), 1e-6));
  EXPECT_TRUE(
      (geometry(Placement::kHigh).rotation * Vec3::UnitZ()).isApprox(Vec3(0, half, half), 1e-6));
  EXPECT_EQ(geometry(Placement::kMid).head_pitch_deg, -10.0);
  EXPECT_EQ(geometry(Placement::kLow).head_pitch_deg, -30.0);
  EXPECT_EQ(geometry(Placement::kHigh).head_pitch_deg, 30.0);
}

TEST(Conditions, StrikeSpeedIsDownwardForLowAndForwardElsewhere) {
  const Vec3 velocity(1.0, -2.0, 3.0);
  EXPECT_EQ(strikeSpeed(geometry(Placement::kLow), velocity), 2.0);
  EXPECT_EQ(strikeSpeed(geometry(Placement::kMid), velocity), 3.0);
  EXPECT_EQ(strikeSpeed(geometry(Placement::kHigh), velocity), 3.0);
}

TEST(Conditions, AMovedAreaKeepsWhatIsNotMoved) {
  const PlacementGeometry higher = geometry(Placement::kMid, xr::Hand::right, {.height_m = 0.05});
  EXPECT_EQ(higher.offset_m, Vec3(0.15, 0.05, 0.40));
  EXPECT_TRUE(higher.rotation.isApprox(Quat::Identity()));
  const PlacementGeometry nearer = geometry(Placement::kLow, xr::Hand::left, {.distance_m = 0.30});
  EXPECT_EQ(nearer.offset_m, Vec3(-0.15, -0.30, 0.30));
  EXPECT_TRUE(nearer.rotation.isApprox(geometry(Placement::kLow).rotation));
  EXPECT_TRUE(nearer.struck_down);
}

TEST(Conditions, ATiltedAreaLiesAsTheStudysDo) {
  for (const Placement placement : {Placement::kLow, Placement::kMid, Placement::kHigh}) {
    const PlacementGeometry study = geometry(placement);
    const double tilt_deg =
        placement == Placement::kLow ? 45.0 : (placement == Placement::kHigh ? -45.0 : 0.0);
    const PlacementGeometry tilted = geometry(Placement::kMid, xr::Hand::right,
                                              {study.offset_m.y(), study.offset_m.z(), tilt_deg});
    EXPECT_EQ(tilted.offset_m, study.offset_m);
    EXPECT_TRUE(tilted.rotation.isApprox(study.rotation, 1e-6));
    EXPECT_EQ(tilted.struck_down, study.struck_down);
    EXPECT_NEAR(tilted.head_pitch_deg, study.head_pitch_deg, 1e-9);
  }
  // Half-way between low and mid, which is struck forward still.
  EXPECT_FALSE(geometry(Placement::kMid, xr::Hand::right, {.tilt_deg = 22.5}).struck_down);
  EXPECT_TRUE(geometry(Placement::kMid, xr::Hand::right, {.tilt_deg = 22.6}).struck_down);
  EXPECT_FALSE(geometry(Placement::kLow, xr::Hand::right, {.tilt_deg = 0.0}).struck_down);
}

TEST(Conditions, TheHeadRequestLiesBetweenThePlacements) {
  const auto pitch = [](double height_m, double distance_m) {
    return geometry(Placement::kMid, xr::Hand::right,
                    {.height_m = height_m, .distance_m = distance_m})
        .head_pitch_deg;
  };
  // The middle of the angles to mid's (-14.04 degrees) and high's (33.69) middles: 9.83 degrees.
  EXPECT_NEAR(pitch(std::tan(9.8275 * std::numbers::pi / 180.0), 1.0), 10.0, 0.01);
  EXPECT_EQ(pitch(1.0, 0.2), 30.0);
  EXPECT_EQ(pitch(-1.0, 0.2), -30.0);
}

TEST(Settings, Defaults) {
  Options options;
  const Settings settings = Settings::fromOptions(options);
  EXPECT_EQ(settings.condition, "medium");
  EXPECT_FALSE(settings.adaptive);
  EXPECT_FALSE(settings.sparse);
  EXPECT_EQ(settings.reward, RewardKind::kReference);
  EXPECT_EQ(settings.round_s, 60.0F);
  EXPECT_EQ(settings.countdown_s, 0.0F);
  EXPECT_TRUE(settings.head_request);
}

TEST(Settings, ReadsEveryOption) {
  Options options = Options::fromJson(
      R"({"condition": "low-easy-unconstrained", "adaptive": true, "sparse": true,
          "reward": "paper", "round_seconds": 10, "countdown_seconds": 4, "head_request": false,
          "show_controllers": false})");
  const Settings settings = Settings::fromOptions(options);
  EXPECT_NO_THROW(options.expectAllRead());
  EXPECT_EQ(settings.condition, "low-easy-unconstrained");
  EXPECT_TRUE(settings.adaptive);
  EXPECT_TRUE(settings.sparse);
  EXPECT_EQ(settings.reward, RewardKind::kPaper);
  EXPECT_EQ(settings.round_s, 10.0F);
  EXPECT_EQ(settings.countdown_s, 4.0F);
  EXPECT_FALSE(settings.head_request);
  EXPECT_FALSE(settings.show_controllers);
}

TEST(Settings, ReadsWhereTheAreaIs) {
  Options options = Options::fromJson(R"({"area_height_m": -0.2, "area_tilt_deg": 30})");
  const Settings settings = Settings::fromOptions(options);
  EXPECT_NO_THROW(options.expectAllRead());
  EXPECT_EQ(settings.area, (AreaChanges{-0.2, std::nullopt, 30.0}));
  EXPECT_EQ(settings.playOptionsJson(), R"({"area_height_m":-0.2,"area_tilt_deg":30.0})");
  EXPECT_EQ(Settings{}.playOptionsJson(), "{}");
  for (const char* wrong : {R"({"area_distance_m": 0.05})", R"({"area_tilt_deg": "flat"})"}) {
    Options refused = Options::fromJson(wrong);
    EXPECT_THROW(Settings::fromOptions(refused), InvalidArgument) << wrong;
  }
}

TEST(Settings, SuggestsTheNearestCondition) {
  Options options = Options::fromJson(R"({"condition": "mediun"})");
  try {
    Settings::fromOptions(options);
    FAIL();
  } catch (const InvalidArgument& error) {
    EXPECT_STREQ(error.what(),
                 "option 'condition': got 'mediun', expected one of 28 names; did you mean "
                 "'medium'?");
  }
}

}  // namespace
}  // namespace sim2vr::games::whacamole

// SPDX-License-Identifier: Apache-2.0
// Rounds of pointing, frame by frame. The head is at (0, 1.2, 0): the circle's centre is at (0.15,
// 1.1, 0.4). A tap takes two frames, and its tip comes through the plane in the middle of the
// second.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "own_folder.hpp"
#include "pointing_player.hpp"

namespace sim2vr::games::pointing {
namespace {

constexpr double kFloat = 1e-5;
/// One block: three targets of 4 cm, 30 cm apart.
constexpr const char* kOneBlock = R"({"targets": 3, "distances_m": [0.3], "widths_m": [0.04]})";

double distanceReward(double distance_m) { return 0.1 * (std::exp(-10.0 * distance_m) - 1.0); }

TEST(Pointing, TheFirstFramePutsTheCircleBeforeTheHead) {
  PointingRound round(kOneBlock);
  round.idle();
  EXPECT_TRUE(round.round().center_m().isApprox(Vec3(0.15, 1.1, 0.4), kFloat));
  EXPECT_EQ(round.round().target(), 0);
  EXPECT_TRUE(round.round().targetCenter(0).isApprox(Vec3(0.15, 1.1 + 0.173205, 0.4), kFloat));
  EXPECT_EQ(round.harness.env().timeFeature(), -1.0F);
  round.head_m = {0.3, 1.0, -0.2};
  round.idle();
  EXPECT_TRUE(round.round().center_m().isApprox(Vec3(0.15, 1.1, 0.4), kFloat));
}

TEST(Pointing, TheHeadIsAskedToLookAtTheCentre) {
  Pointing game;
  EXPECT_NEAR(*game.headRequest(1), -14.036, 1e-3);  // 10 cm below at 40 cm
  Options options = Options::fromJson(R"({"head_request": false})");
  game.configure(options);
  EXPECT_FALSE(game.headRequest(1));
}

TEST(Pointing, AHitIsWorthTenAndTheNextTargetIsUpInTheSameFrame) {
  PointingRound round(kOneBlock);
  round.idle();
  round.tap();
  EXPECT_EQ(round.log("Points"), 1.0);
  EXPECT_EQ(round.round().target(), 2);
  // The tip is 2 cm behind the plane, 30 cm from the next target along it.
  const double distance_m = std::hypot(0.3, 0.02);
  EXPECT_NEAR(round.harness.env().reward(), 10.0 + distanceReward(distance_m), kFloat);
  EXPECT_NEAR(round.harness.env().timeFeature(), 2.0 / 4.0 - 1.0, kFloat);
  const auto sounds = round.harness.sounds().take();
  ASSERT_EQ(sounds.size(), 1U);
  EXPECT_EQ(sounds[0].name, "hit");
  EXPECT_EQ(round.harness.session().takePulses().size(), 1U);
}

TEST(Pointing, ASelectionBesideTheTargetIsAnErrorAndEndsTheTrial) {
  PointingRound round(kOneBlock);
  round.idle();
  round.tap({0.019, 0.0, 0.0});
  EXPECT_EQ(round.log("Points"), 1.0);
  round.tap({0.0, -0.021, 0.0});
  EXPECT_EQ(round.log("Points"), 1.0);
  EXPECT_EQ(round.log("Errors"), 1.0);
  EXPECT_EQ(round.log("ErrorReward"), -5.0);
  EXPECT_EQ(round.round().target(), 1);
  EXPECT_EQ(round.harness.sounds().take().back().name, "error");
}

TEST(Pointing, TheTipIsFollowedBetweenFrames) {
  PointingRound round(kOneBlock);
  round.idle();
  const Vec3 target = round.round().targetCenter(0);
  // From 6 cm to the left and 3 cm before the plane to 2 cm to the right and 1 cm behind it: it
  // comes through after three quarters of the frame, in the middle.
  round.frame(target + Vec3(-0.06, 0.0, -0.03));
  round.frame(target + Vec3(0.02, 0.0, 0.01));
  EXPECT_EQ(round.log("Points"), 1.0);
  // The same way again, but from 2 cm further to the left: 2 cm beside it, where the target ends.
  PointingRound other(kOneBlock);
  other.idle();
  other.frame(target + Vec3(-0.0801, 0.0, -0.03));
  other.frame(target + Vec3(-0.0001, 0.0, 0.01));
  EXPECT_EQ(other.log("Points"), 0.0);
  EXPECT_EQ(other.log("Errors"), 1.0);
}

TEST(Pointing, TheTipMustComeOutOfThePlaneBetweenSelections) {
  PointingRound round(R"({"targets": 3, "distances_m": [0.3], "widths_m": [0.04],
                          "rearm_m": 0.01})");
  round.idle();
  round.tap();
  const Vec3 target = round.round().targetCenter(round.round().target());
  const auto through = [&](double before_m) {
    round.frame(target - Vec3(0.0, 0.0, before_m));
    round.frame(target + Vec3(0.0, 0.0, 0.02));
  };
  through(-0.01);  // it stays behind
  through(0.009);
  EXPECT_EQ(round.log("Selections"), 1.0);
  through(0.011);
  EXPECT_EQ(round.log("Selections"), 2.0);
  // By default it need only be out.
  PointingRound other(kOneBlock);
  other.idle();
  other.tap();
  for (const double before_m : {0.0, 0.001}) {
    const Vec3 next = other.round().targetCenter(other.round().target());
    other.frame(next - Vec3(0.0, 0.0, before_m));
    other.frame(next + Vec3(0.0, 0.0, 0.02));
    EXPECT_EQ(other.log("Selections"), before_m > 0.0 ? 2.0 : 1.0);
  }
}

TEST(Pointing, AStylusThatBeginsBehindThePlaneSelectsNothing) {
  PointingRound round(kOneBlock);
  round.frame({0.15, 1.27, 0.5});
  round.frame({0.15, 1.27, 0.6});
  EXPECT_EQ(round.log("Selections"), 0.0);
  // Neither does one that comes from nowhere.
  round.hand = xr::Hand::left;
  round.idle();
  round.hand = xr::Hand::right;
  round.frame({0.15, 1.27, 0.6});
  EXPECT_EQ(round.log("Selections"), 0.0);
}

TEST(Pointing, ATargetThatIsNotSelectedTimesOut) {
  PointingRound round(R"({"targets": 3, "distances_m": [0.3], "widths_m": [0.04],
                          "timeout_seconds": 0.5})");
  round.idle(10);  // up to 0.45 s
  EXPECT_EQ(round.log("Timeouts"), 0.0);
  round.idle();
  EXPECT_EQ(round.log("Timeouts"), 1.0);
  EXPECT_EQ(round.log("Failures"), 1.0);
  EXPECT_EQ(round.round().target(), 2);
  // A movement begins with a selection.
  round.tap();
  EXPECT_EQ(round.log("Movements"), 0.0);
  round.tap();
  EXPECT_EQ(round.log("Movements"), 1.0);
  EXPECT_NEAR(round.log("MovementTime"), 0.1, kFloat);
}

// Offsets along the ways to targets 2, 1 and 0 of -4, 0 and +4 mm; the first tap is in the middle.
// Lengths: 296 mm; 298 mm, since 4 mm from target 2 towards target 0 is 4 mm cos 60 deg towards
// target 1; 304 mm.
TEST(Pointing, ABlockIsMeasured) {
  PointingRound round(kOneBlock);
  round.idle();
  round.tap();
  const std::vector<double> offsets_m{-0.004, 0.0, 0.004};
  const std::vector<int> waits{2, 4, 6};
  for (std::size_t i = 0; i < 3; ++i) {
    const int trial = static_cast<int>(i) + 1;
    const Vec3 axis = (round.round().targetCenter(targetOfTrial(trial, 3)) -
                       round.round().targetCenter(targetOfTrial(trial - 1, 3)))
                          .normalized();
    round.idle(waits[i]);
    EXPECT_FALSE(round.harness.env().finished());
    round.tap(offsets_m[i] * axis);
  }
  EXPECT_TRUE(round.harness.env().finished());
  EXPECT_EQ(round.harness.env().timeFeature(), 1.0F);
  EXPECT_EQ(round.log("Points"), 4.0);
  EXPECT_EQ(round.log("Movements"), 3.0);
  EXPECT_EQ(round.log("Blocks"), 1.0);
  // Taps of two frames after waits of 2, 4 and 6.
  EXPECT_NEAR(round.log("MovementTime"), (0.2 + 0.3 + 0.4) / 3.0, kFloat);
  EXPECT_NEAR(round.log("EndpointSpread"), 0.004, 1e-6);
  EXPECT_NEAR(round.log("IndexOfDifficulty"), std::log2(8.5), kFloat);
  const double distance_m = (0.296 + (0.300 - 0.002) + 0.304) / 3.0;
  const double index = std::log2(distance_m / (4.133 * 0.004) + 1.0);
  EXPECT_NEAR(round.log("EffectiveIndex"), index, 1e-4);
  EXPECT_NEAR(round.log("Throughput"), index / 0.3, 1e-3);
}

TEST(Pointing, ARoundPlaysAllBlocksAndEnds) {
  PointingRound round(R"({"targets": 5, "repeats": 2})");
  round.idle();
  const std::vector<Block> blocks = round.round().blocks();
  ASSERT_EQ(blocks.size(), 18U);
  EXPECT_EQ(round.log("Trials"), 108.0);
  for (std::size_t block = 0; block < blocks.size(); ++block) {
    EXPECT_EQ(round.round().block().width_m, blocks[block].width_m);
    EXPECT_EQ(round.round().block().distance_m, blocks[block].distance_m);
    for (int trial = 0; trial <= 5; ++trial) {
      EXPECT_EQ(round.round().trial(), trial);
      EXPECT_FALSE(round.harness.env().finished());
      round.tap();
    }
  }
  EXPECT_TRUE(round.harness.env().finished());
  EXPECT_EQ(round.log("Points"), 108.0);
  EXPECT_EQ(round.log("Movements"), 90.0);
  EXPECT_EQ(round.log("Blocks"), 0.0);  // without spread, no throughput
}

TEST(Pointing, ALeftHandPlaysTheMirrorImage) {
  PointingRound round(R"({"targets": 3, "distances_m": [0.3], "widths_m": [0.04],
                          "hand": "left"})");
  round.hand = xr::Hand::left;
  round.idle();
  EXPECT_TRUE(round.round().center_m().isApprox(Vec3(-0.15, 1.1, 0.4), kFloat));
  round.tap();
  EXPECT_EQ(round.log("Points"), 1.0);
}

TEST(Pointing, SparseRewardsAreHitsAndErrorsOnly) {
  PointingRound round(R"({"sparse": true, "error_cost": 2})");
  round.idle();
  EXPECT_EQ(round.harness.env().reward(), 0.0F);
  EXPECT_TRUE(std::isnan(round.log("DistanceReward")));
  round.tap();
  EXPECT_EQ(round.harness.env().reward(), 10.0F);
  round.tap({0.1, 0.0, 0.0});
  EXPECT_EQ(round.harness.env().reward(), -2.0F);
}

std::string readAll(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

TEST(Pointing, LogsSaySelectionsWithPlaceAndTime) {
  const sim2vr::testing::OwnFolder folder;
  rl::EpisodeLogger logger(folder.path());
  PointingRound round(R"({"targets": 3, "distances_m": [0.3], "widths_m": [0.04],
                          "timeout_seconds": 0.5})",
                      7, &logger);
  round.idle();
  round.tap();
  round.tap({-0.030, 0.0, 0.0});
  round.idle(10);
  round.tap();
  EXPECT_TRUE(round.harness.env().finished());
  const std::string events = readAll(folder / "0000-pointing" / "events.csv");
  for (const char* line : {
           "game options {\"distances_m\":[0.3],\"targets\":3,\"timeout_seconds\":0.5,"
           "\"widths_m\":[0.04]}",
           "target plane transform 0.15 1.1 0.4 0 0 0 1",
           "block_start, block 0, distance 0.3, width 0.04, index 3.08746",
           "target_spawn, target ID 0, grid ID 0, block 0, trial 0, center 0 0.173205",
           "0.075, target_hit, target ID 0, grid ID 0, block 0, trial 0, place ",
           "target_error, target ID 1, grid ID 2, block 0, trial 1, place -0.17999999 -0.0866",
           ", movement time 0.10000001, offset 0.0150000",
           ", length 0.315",
           "target_miss, target ID 2, grid ID 1, block 0, trial 2",
           "block_end, block 0, movements 1",
           "episode statistics, hits 2, errors 1, timeouts 1",
       }) {
    EXPECT_NE(events.find(line), std::string::npos) << line << "\n" << events;
  }
  const std::string states = readAll(folder / "0000-pointing" / "states.csv");
  EXPECT_TRUE(states.starts_with("condition pointing, random seed 7")) << states.substr(0, 200);
}

class Observed {
 public:
  explicit Observed(PointingRound& round)
      : names_(round.game.privilegedNames()), values_(names_.size()) {
    round.harness.env().fillPrivileged(values_);
  }
  double operator()(const std::string& name) const {
    const auto found = std::find(names_.begin(), names_.end(), name);
    if (found == names_.end()) throw std::out_of_range(name);
    return static_cast<double>(values_[static_cast<std::size_t>(found - names_.begin())]);
  }
  Vec3 vector(const std::string& name, const std::string& unit = "_m") const {
    return {(*this)(name + "x" + unit), (*this)(name + "y" + unit), (*this)(name + "z" + unit)};
  }

 private:
  const std::vector<std::string>& names_;
  std::vector<float> values_;
};

TEST(PointingPrivileged, TellsTipTargetAndTheOneAfterIt) {
  PointingRound round(kOneBlock);
  round.frame({0.10, 1.0, 0.30});
  round.frame({0.11, 1.0, 0.30});
  const Observed observed(round);
  EXPECT_TRUE(observed.vector("tip.").isApprox(Vec3(0.11, -0.2, 0.30), kFloat));
  EXPECT_TRUE(observed.vector("tip.v", "_mps").isApprox(Vec3(0.2, 0.0, 0.0), 1e-4));
  EXPECT_NEAR(observed("tip.depth_m"), -0.10, kFloat);
  EXPECT_EQ(observed("tip.armed"), 1.0);
  EXPECT_EQ(observed("target.present"), 1.0);
  EXPECT_EQ(observed("target.start"), 1.0);
  EXPECT_NEAR(observed("target.width_m"), 0.04, kFloat);
  EXPECT_NEAR(observed("target.age_s"), 0.05, kFloat);
  EXPECT_TRUE(observed.vector("target.").isApprox(Vec3(0.04, 0.273205, 0.10), 1e-4));
  EXPECT_EQ(observed("next.present"), 1.0);
  EXPECT_TRUE(observed.vector("target.place_").isApprox(Vec3(0.15, 0.073205, 0.40), 1e-4));
  EXPECT_TRUE(observed.vector("next.place_").isApprox(Vec3(0.0, -0.1866025, 0.40), 1e-4));
  EXPECT_TRUE(Vec3(observed("round.side_m"), observed("round.height_m"), observed("round.depth_m"))
                  .isApprox(Vec3(0.15, -0.10, 0.40), kFloat));
  // It is 17.3 cm above the circle's centre, 0 beside it, and 4 cm wide.
  for (const char* yes : {"x0", "x3", "y0", "y7", "width0", "width1"}) {
    EXPECT_EQ(observed(std::string("shown.") + yes), 1.0) << yes;
  }
  for (const char* no : {"x4", "x7"}) EXPECT_EQ(observed(std::string("shown.") + no), 0.0) << no;
  // The nearest start of a tap is 5 cm before target 2, at (0, 1.0133975, 0.35).
  EXPECT_NEAR(observed("aid.start_distance_m"), Vec3(0.11, -0.0133975, -0.05).norm(), 1e-4);
}

TEST(PointingPrivileged, InTheLastTrialOfABlockNothingIsNext) {
  PointingRound round(kOneBlock);
  round.idle();
  for (int i = 0; i < 3; ++i) round.tap();
  const Observed observed(round);
  EXPECT_EQ(observed("target.present"), 1.0);
  EXPECT_EQ(observed("target.start"), 0.0);
  EXPECT_EQ(observed("next.present"), 0.0);
  round.tap();
  EXPECT_EQ(Observed(round)("target.present"), 0.0);
}

TEST(PointingPrivileged, ATargetIsObservedOnceItHasBeenInView) {
  PointingRound round(kOneBlock);
  round.head_rotation = Quat(Eigen::AngleAxisd(3.14159, Vec3::UnitY()));
  round.idle();
  EXPECT_EQ(Observed(round)("target.present"), 0.0);
  EXPECT_EQ(Observed(round).vector("target."), Vec3::Zero());
  round.head_rotation = Quat::Identity();
  round.idle();
  EXPECT_EQ(Observed(round)("target.present"), 1.0);
  round.head_rotation = Quat(Eigen::AngleAxisd(3.14159, Vec3::UnitY()));
  round.idle();
  EXPECT_EQ(Observed(round)("target.present"), 1.0);
}

}  // namespace
}  // namespace sim2vr::games::pointing

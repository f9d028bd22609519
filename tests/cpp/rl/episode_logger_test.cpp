// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "own_folder.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/rl/episode_logger.hpp"

namespace sim2vr::rl {
namespace {

class EpisodeLoggerTest : public ::testing::Test {
 protected:
  std::string read(const std::string& path) const {
    std::ifstream file(root_ / path, std::ios::binary);
    std::ostringstream text;
    text << file.rdbuf();
    return text.str();
  }

  const testing::OwnFolder folder_;
  const std::filesystem::path root_ = folder_ / "logs";
  const std::vector<std::string> names_{"head", "marker"};
};

TEST(FormatFloat, PrintsTheFewestDigitsThatGiveTheNumberBack) {
  EXPECT_EQ(formatFloat(0.0999999940), "0.099999994");
  EXPECT_EQ(formatFloat(0.05), "0.05");
  EXPECT_EQ(formatFloat(0.049999997), "0.049999997");
  EXPECT_EQ(formatFloat(328.9481), "328.9481");
  EXPECT_EQ(formatFloat(-0.0871557), "-0.0871557");
  EXPECT_EQ(formatFloat(2.188797e-8), "2.188797E-08");
  EXPECT_EQ(formatFloat(0.0001), "0.0001");
  EXPECT_EQ(formatFloat(0.00001), "1E-05");
  EXPECT_EQ(formatFloat(12345678.0), "12345678");
  EXPECT_EQ(formatFloat(-0.0), "0");
  EXPECT_EQ(formatFloat(1.0), "1");
  EXPECT_EQ(formatFloat(0.0 / 0.0), "NaN");
  EXPECT_EQ(formatFloat(1.0 / 0.0), "Infinity");
}

TEST_F(EpisodeLoggerTest, WritesTheReferenceFormat) {
  EpisodeLogger logger(root_);
  logger.beginRound("medium", 42, names_);
  const std::vector<Pose> poses{{Vec3(1.0, 2.5, -3.0), Quat(1.0, 0.0, 0.0, 0.0)},
                                {Vec3(0.0, 0.1, 0.2), Quat(0.5, -0.5, 0.5, 0.5)}};
  logger.state(0.05F, poses);
  logger.event(0.05F, "target_spawn, target ID 0, grid ID 5");
  logger.endRound();
  EXPECT_EQ(read("0000-medium/states.csv"),
            "condition medium, random seed 42\n"
            "timestamp, head_pos_x, head_pos_y, head_pos_z, head_quat_x, head_quat_y, head_quat_z, "
            "head_quat_w, marker_pos_x, marker_pos_y, marker_pos_z, marker_quat_x, marker_quat_y, "
            "marker_quat_z, marker_quat_w\n"
            "0.05, 1, 2.5, -3, 0, 0, 0, 1, 0, 0.1, 0.2, -0.5, 0.5, 0.5, 0.5\n");
  EXPECT_EQ(read("0000-medium/events.csv"), "0.05, target_spawn, target ID 0, grid ID 5\n");
}

TEST_F(EpisodeLoggerTest, CountsRoundsAndClosesTheOneBefore) {
  EpisodeLogger logger(root_);
  logger.beginRound("easy", 1, names_);
  logger.event(1.0F, "first");
  logger.beginRound("hard", 2, names_);
  EXPECT_EQ(read("0000-easy/events.csv"), "1, first\n");
  EXPECT_TRUE(std::filesystem::exists(root_ / "0001-hard" / "states.csv"));
  EXPECT_EQ(logger.folder(), root_ / "0001-hard");
}

TEST_F(EpisodeLoggerTest, FlushesOnDestruction) {
  {
    EpisodeLogger logger(root_);
    logger.beginRound("easy", 1, names_);
    logger.event(1.0F, "only");
  }
  EXPECT_EQ(read("0000-easy/events.csv"), "1, only\n");
}

TEST_F(EpisodeLoggerTest, IgnoresRowsOutsideARound) {
  EpisodeLogger logger(root_);
  logger.event(1.0F, "nothing");
  logger.state(1.0F, {});
  logger.endRound();
  EXPECT_FALSE(std::filesystem::exists(root_));
}

TEST_F(EpisodeLoggerTest, RefusesAnotherNumberOfPoses) {
  EpisodeLogger logger(root_);
  logger.beginRound("easy", 1, names_);
  try {
    logger.state(1.0F, std::vector<Pose>(3));
    FAIL();
  } catch (const InvalidArgument& error) {
    EXPECT_STREQ(error.what(), "poses: got 3 poses, expected 2, as named in beginRound");
  }
}

TEST_F(EpisodeLoggerTest, SaysWhichFolderCannotBeMade) {
  std::filesystem::create_directories(root_.parent_path());
  {
    std::ofstream(root_) << "a file in the way";
  }
  EpisodeLogger logger(root_);
  try {
    logger.beginRound("easy", 1, names_);
    FAIL();
  } catch (const EngineError& error) {
    EXPECT_NE(std::string(error.what()).find("cannot make the folder " + root_.string()),
              std::string::npos);
  }
}

}  // namespace
}  // namespace sim2vr::rl

// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <filesystem>

#include "own_folder.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/rl/episode_logger.hpp"
#include "sim2vr/rl/state_log.hpp"

namespace sim2vr::rl {
namespace {

const std::string kHeader = [] {
  std::string header = "timestamp";
  for (const char* name : {"left", "right", "head"}) {
    for (const char* axis : {"pos_x", "pos_y", "pos_z", "quat_x", "quat_y", "quat_z", "quat_w"}) {
      header += std::string(", ") + name + "_" + axis;
    }
  }
  return header + "\n";
}();

const std::string kTitle = "condition hard, random seed 42\n";

std::string row(const std::string& time) {
  return time + ", 0, 0, 0, 0, 0, 0, 1, 1, 2, 3, 4, 5, 6, 7, -1E-05, .5, 9, 0, 0, 0, 1\n";
}

std::string refusal(const std::string& text) {
  try {
    parseStateLog(text);
  } catch (const InvalidArgument& error) {
    return error.what();
  }
  return "accepted";
}

TEST(StateLog, Rows) {
  const StateLog log = parseStateLog(kTitle + kHeader + row("0") + row("0.05") + "\n");
  EXPECT_EQ(log.condition, "hard");
  EXPECT_EQ(log.seed, 42U);
  ASSERT_EQ(log.rows.size(), 2U);
  EXPECT_EQ(log.rows[1].time_s, 0.05);
  EXPECT_EQ(log.rows[1].right, (StateLog::PoseNumbers{1, 2, 3, 4, 5, 6, 7}));
  EXPECT_EQ(log.rows[1].head, (StateLog::PoseNumbers{-1e-5, 0.5, 9, 0, 0, 0, 1}));
  EXPECT_FALSE(log.rows[1].left_tracked);
}

TEST(StateLog, ConditionsMayHaveSeveralWords) {
  const StateLog log =
      parseStateLog("condition generated 2032329983, random seed 42\n" + kHeader + row("0"));
  EXPECT_EQ(log.condition, "generated 2032329983");
  EXPECT_EQ(log.seed, 42U);
}

TEST(StateLog, ReadsWhatTheLoggerWrites) {
  const testing::OwnFolder root;
  const Pose left{Vec3(0.1, 0.2, 0.3), Quat(0.5, 0.5, 0.5, 0.5)};
  const Pose right{Vec3(1.0 / 3.0, -2e-7, 5.0), Quat(1.0, 0.0, 0.0, 0.0)};
  {
    EpisodeLogger logger(root.path());
    const std::vector<std::string> names{"left", "right", "head", "marker"};
    logger.beginRound("low-easy", 4294967295U, names);
    const std::array<Pose, 4> poses{left, right, right, left};
    logger.state(0.1F, poses);
    logger.endRound();
  }
  const StateLog log = readStateLog(root / "0000-low-easy" / "states.csv");
  EXPECT_EQ(log.condition, "low-easy");
  EXPECT_EQ(log.seed, 4294967295U);
  ASSERT_EQ(log.rows.size(), 1U);
  EXPECT_TRUE(log.rows[0].left_tracked);
  // The very binary32 numbers.
  EXPECT_EQ(static_cast<float>(log.rows[0].time_s), 0.1F);
  EXPECT_EQ(static_cast<float>(log.rows[0].right[0]), static_cast<float>(1.0 / 3.0));
  EXPECT_EQ(static_cast<float>(log.rows[0].right[1]), -2e-7F);
}

// tests/python/sessions/test_state_log.py has the same cases.
TEST(StateLog, AsASpreadsheetSavesIt) {
  const std::string plain = kTitle + kHeader + row("0") + row("0.05");
  const auto replaced = [&](std::string text, const std::string& from, const std::string& to) {
    for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size()) {
      text.replace(at, from.size(), to);
    }
    return text;
  };
  for (const std::string& text :
       {replaced(plain, "\n", ",,,\n"), replaced(plain, "\n", "\r\n"), replaced(plain, "\n", "\r"),
        replaced(plain, ", ", "\t"), replaced(plain, ", ", ","), "\xEF\xBB\xBF" + plain,
        plain + ",,,\n\n", plain + "0.1, 0, 0", plain + row("1e-"),
        plain.substr(0, plain.size() - 1)}) {
    const StateLog log = parseStateLog(text);
    EXPECT_EQ(log.condition, "hard");
    EXPECT_EQ(log.seed, 42U);
    ASSERT_EQ(log.rows.size(), 2U) << text;
    EXPECT_EQ(log.rows[1].time_s, 0.05);
    EXPECT_EQ(log.rows[1].head, (StateLog::PoseNumbers{-1e-5, 0.5, 9, 0, 0, 0, 1}));
  }
}

TEST(StateLog, AnySeed) {
  const std::pair<const char*, std::uint32_t> seeds[] = {{"-1", 4294967295U},
                                                         {"-2147483648", 2147483648U},
                                                         {"4294967296", 0U},
                                                         {"123456789012345678901", 792095797U}};
  for (const auto& [text, seed] : seeds) {
    const std::string title = std::string("condition hard, random seed ") + text + "\n";
    EXPECT_EQ(parseStateLog(title + kHeader + row("0")).seed, seed) << text;
  }
}

TEST(StateLog, SaysWhatIsWrongWhere) {
  EXPECT_EQ(refusal(""), "states.csv line 0: got '', expected 'condition C, random seed N'");
  EXPECT_EQ(refusal("condition hard\n"),
            "states.csv line 1: got 'condition hard', expected 'condition C, random seed N'");
  EXPECT_EQ(refusal("condition hard, random seed 1.5\n").find("states.csv line 1"), 0U);
  EXPECT_EQ(refusal("condition hard, random seed -\n").find("states.csv line 1"), 0U);
  EXPECT_EQ(refusal(kTitle), "states.csv line 1: got '', expected the names of the columns");
  EXPECT_EQ(refusal(kTitle + "timestamp, left_pos_x\n"),
            "states.csv line 2: got 'timestamp, left_pos_x', expected a column left_pos_x and six "
            "more for the pose");
  EXPECT_EQ(refusal(kTitle + kHeader), "states.csv line 2: got '', expected at least one row");
  EXPECT_EQ(refusal(kTitle + kHeader + "0, 1\n"),
            "states.csv line 3: got '0, 1', expected 22 numbers, as the header has columns");
  EXPECT_EQ(refusal(kTitle + kHeader + row("NaN")).find("states.csv line 3: got 'NaN, 0"), 0U);
  EXPECT_EQ(refusal(kTitle + kHeader + row("1e999")).find("states.csv line 3"), 0U);
  EXPECT_EQ(refusal(kTitle + kHeader + row("-1")),
            "states.csv line 3: got '-1', expected 0 to 1e9 s");
  EXPECT_EQ(refusal(kTitle + kHeader + row("1") + row("0.5")),
            "states.csv line 4: got '0.5', expected a time from the row above to 1e9 s");
  EXPECT_EQ(refusal(kTitle + kHeader + row("1") + "2, 3\n" + row("4")).find("states.csv line 4"),
            0U);
  EXPECT_THROW(readStateLog("nosuch.csv"), InvalidArgument);
  EXPECT_THROW(readStateLog(::testing::TempDir()), InvalidArgument);
}

}  // namespace
}  // namespace sim2vr::rl

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/program/arguments.hpp"

#include <gtest/gtest.h>

#include <sstream>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/program/program.hpp"

namespace sim2vr::program {
namespace {

using Words = std::vector<std::string>;

Words translated(const Words& words, Words* warnings = nullptr) {
  Words own;
  return translateReferenceArguments(words, warnings == nullptr ? own : *warnings);
}

TEST(ReferenceArguments, InAnyOrderAndForm) {
  EXPECT_EQ(translated({"-simulated", "-port", "6000", "-logFile", "a b.log"}),
            (Words{"--simulated", "--port=6000", "--log-file=a b.log"}));
  EXPECT_EQ(translated({"-condition=medium", "-adaptive", "-resolution 640x480", "-record"}),
            (Words{"--condition=medium", "--adaptive", "--resolution=640x480", "--record"}));
  // Our own options pass as they are, negative numbers are values.
  EXPECT_EQ(translated({"--port", "0", "-fixedSeed", "-5"}),
            (Words{"--port", "0", "--fixed-seed=0"}));
}

TEST(ReferenceArguments, UnknownOnesAreWarnedAboutOnceAndSkipped) {
  Words warnings;
  EXPECT_EQ(translated({"-batchmode", "-screen-width", "1", "-prot", "7", "-sparse"}, &warnings),
            (Words{"--sparse"}));
  ASSERT_EQ(warnings.size(), 3U);
  EXPECT_EQ(warnings[0], "the argument -batchmode is not known and has no effect");
  EXPECT_EQ(warnings[2],
            "the argument -prot is not known and has no effect; did you mean '-port'?");
}

TEST(ReferenceArguments, MissingValues) {
  for (const Words& words : {Words{"-condition"}, Words{"-condition", "-adaptive"},
                             Words{"-condition="}, Words{"-condition", "--port", "0"}}) {
    try {
      translated(words);
      FAIL() << "no error";
    } catch (const InvalidArgument& error) {
      EXPECT_STREQ(error.what(), "-condition: got no value, expected one after it");
    }
  }
  EXPECT_THROW(translated({"-adaptive=1"}), InvalidArgument);
}

// The reference plays on with seed 0; a program that ends lets its client wait for ever.
TEST(ReferenceArguments, AnUnreadableFixedSeedIsNone) {
  for (const Words& words :
       {Words{"-fixedSeed", "abc"}, Words{"-fixedSeed", "-5"}, Words{"-fixedSeed=1.5"},
        Words{"-fixedSeed", "4294967296"}, Words{"-fixedSeed", "1 2"}, Words{"-fixedSeed"},
        Words{"-fixedSeed="}}) {
    std::vector<std::string> warnings;
    EXPECT_EQ(translateReferenceArguments(words, warnings), Words{"--fixed-seed=0"});
    ASSERT_EQ(warnings.size(), 1U);
    EXPECT_EQ(warnings[0].find("-fixedSeed: got '"), 0U) << warnings[0];
  }
  EXPECT_EQ(translated({"-fixedSeed", "4294967295"}), Words{"--fixed-seed=4294967295"});
  EXPECT_EQ(parseArguments({"-fixedSeed", "abc"}).fixed_seed, 0U);
  EXPECT_THROW(parseArguments({"--fixed-seed", "abc"}), InvalidArgument) << "ours says so";
}

TEST(Arguments, ModeFollowsFromTheArguments) {
  EXPECT_EQ(parseArguments({}).mode, Mode::serve);
  EXPECT_EQ(parseArguments({"--port", "0"}).mode, Mode::serve);
  EXPECT_EQ(parseArguments({"--play"}).mode, Mode::play);
  EXPECT_EQ(parseArguments({"--seconds", "2"}).mode, Mode::play);
  EXPECT_EQ(parseArguments({"--script", "x"}).mode, Mode::play);
  EXPECT_EQ(parseArguments({"-replay", "-stateLogFilepath", "x"}).mode, Mode::replay);
  EXPECT_EQ(parseArguments({"--list-games"}).mode, Mode::list_games);
  EXPECT_THROW(parseArguments({"--play", "--port", "0"}), InvalidArgument);
}

TEST(Arguments, AsUserInTheBoxStartsItsApps) {
  const Arguments arguments =
      parseArguments({"-simulated", "-port", "41234", "-logFile", "/tmp/app.log", "-condition",
                      "low-medium", "-adaptive", "-sparse", "-outputFolder", "/tmp/out", "-record",
                      "-resolution", "640x480", "-logging", "-fixedSeed", "77"});
  EXPECT_EQ(arguments.mode, Mode::serve);
  EXPECT_TRUE(arguments.simulated);
  EXPECT_EQ(arguments.port, 41234);
  EXPECT_EQ(arguments.log_file, "/tmp/app.log");
  EXPECT_EQ(gameOptions(arguments), R"({"adaptive":true,"condition":"low-medium","sparse":true})");
  EXPECT_EQ(arguments.record, "/tmp/out/recording");
  EXPECT_EQ(arguments.log_dir, "/tmp/out/logging");
  EXPECT_EQ(arguments.resolution, (render::ImageSize{640, 480}));
  EXPECT_EQ(arguments.fixed_seed, 77U);
  EXPECT_EQ(arguments.frame_time, "next");
  EXPECT_EQ(arguments.clock, "absolute");
  EXPECT_TRUE(arguments.warnings.empty());
  EXPECT_FALSE(arguments.timeout_s);
}

// As the harness starts it with arguments that a Unity build would take.
TEST(Arguments, TheReferencesBesideOurOwn) {
  const Arguments arguments = parseArguments(
      {"--bind", "ipc:///tmp/app", "--timeout", "86400", "--game", "whacamole", "--options",
       R"({"round_seconds":2.0})", "--width", "120", "-condition", "easy", "-batchmode"});
  EXPECT_EQ(arguments.mode, Mode::serve);
  EXPECT_FALSE(arguments.simulated);
  EXPECT_EQ(arguments.bind, "ipc:///tmp/app");
  EXPECT_EQ(gameOptions(arguments), R"({"condition":"easy","round_seconds":2.0})");
  EXPECT_EQ(arguments.warnings.size(), 1U);
}

TEST(Arguments, Recordings) {
  EXPECT_TRUE(parseArguments({"--port", "0"}).record.empty());
  EXPECT_EQ(parseArguments({"--record", "--port", "0"}).record, "./recording");
  EXPECT_EQ(parseArguments({"--record", "there"}).record, "there");
  EXPECT_EQ(parseArguments({"--record-mp4", "--output-folder", "x"}).record, "x/recording");
  EXPECT_EQ(parseArguments({"--logging", "--log-dir", "there"}).log_dir, "there");
  for (const char* size : {"640", "640x", "x480", "640x480x3", "0x480", "-1x4", "9000x10"}) {
    EXPECT_THROW(parseArguments({std::string("--resolution=") + size}), InvalidArgument) << size;
  }
}

TEST(Arguments, TheLastOfTwoCounts) {
  EXPECT_EQ(parseArguments({"-condition", "easy", "-condition", "hard"}).condition, "hard");
}

TEST(Arguments, HelpVersionAndMistakes) {
  const auto finished = [](const Words& words) {
    try {
      parseArguments(words);
    } catch (const Finished& end) {
      return std::pair<std::string, int>(end.what(), end.exitCode());
    }
    return std::pair<std::string, int>("not finished", -1);
  };
  EXPECT_EQ(finished({"--version"}).first.find("sim2vr-app "), 0U);
  EXPECT_EQ(finished({"--help"}).second, 0);
  EXPECT_NE(finished({"-h"}).first.find("-stateLogFilepath"), std::string::npos);
  EXPECT_EQ(finished({"--nosuch"}).second, 2);
  EXPECT_EQ(finished({"--seed"}).first,
            "sim2vr-app: --seed: got no value, expected one (see sim2vr-app --help)\n");
  EXPECT_EQ(finished({"--second", "2"}).first,
            "sim2vr-app: --second: got an unknown argument, expected an option; did you mean "
            "'--seconds'? (see sim2vr-app --help)\n");
  EXPECT_EQ(finished({"round.json"}).first,
            "sim2vr-app: round.json: got an unknown argument, expected an option (see sim2vr-app "
            "--help)\n");
}

TEST(Arguments, NumbersAreFiniteAndInTheirRange) {
  for (const std::string name :
       {"--timeout", "--time-scale", "--seconds", "--playback-rate", "--port", "--threads",
        "--frame-rate", "--seed", "--fixed-seed", "--width", "--height"}) {
    for (const std::string value : {"nan", "-nan", "inf", "1e300", "-1", "x", "1x"}) {
      EXPECT_THROW(parseArguments({name + "=" + value}), InvalidArgument) << name << "=" << value;
    }
  }
  EXPECT_EQ(parseArguments({"--seconds", "0.25"}).seconds, 0.25);
  EXPECT_EQ(parseArguments({"--seed", "4294967295"}).seed, 4294967295U);
  EXPECT_EQ(parseArguments({"--timeout", "2"}).timeout_s, 2.0);
}

TEST(Arguments, HelpFits80Columns) {
  try {
    parseArguments({"--help"});
    FAIL() << "no help";
  } catch (const Finished& end) {
    std::istringstream lines(end.what());
    std::string line;
    while (std::getline(lines, line)) EXPECT_LE(line.size(), 80U) << line;
  }
}

TEST(Arguments, AConditionIsTheOptionsThatItsGamePublishes) {
  EXPECT_EQ(gameOptions(parseArguments({"--game", "sample", "--condition", "small"})),
            R"({"ball_radius_m":0.025})");
  try {
    gameOptions(parseArguments({"--game", "sample", "--condition", "smal"}));
    FAIL();
  } catch (const InvalidArgument& error) {
    EXPECT_STREQ(error.what(),
                 "--condition: got 'smal', expected one of 'big', 'usual' or 'small'; did you mean "
                 "'small'?");
  }
}

TEST(Arguments, OptionsThatContradictEachOther) {
  EXPECT_EQ(gameOptions(parseArguments(
                {"--options", R"({"condition":"easy","reward":"paper"})", "--condition", "easy"})),
            R"({"condition":"easy","reward":"paper"})");
  EXPECT_THROW(
      gameOptions(parseArguments({"--options", R"({"condition":"easy"})", "--condition", "hard"})),
      InvalidArgument);
  EXPECT_THROW(gameOptions(parseArguments({"--options", "[1]"})), InvalidArgument);
}

}  // namespace
}  // namespace sim2vr::program

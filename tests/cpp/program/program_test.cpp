// SPDX-License-Identifier: Apache-2.0
// What the program says and how it ends, without starting one.
#include "sim2vr/program/program.hpp"
#include "own_folder.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>

namespace sim2vr::program {
namespace {

struct Outcome {
  int code = -1;
  std::string out;
  std::string err;
};

Outcome runWith(std::vector<const char*> words) {
  words.insert(words.begin(), "sim2vr-app");
  ::testing::internal::CaptureStdout();
  ::testing::internal::CaptureStderr();
  Outcome outcome;
  outcome.code = run(static_cast<int>(words.size()), words.data());
  outcome.out = ::testing::internal::GetCapturedStdout();
  outcome.err = ::testing::internal::GetCapturedStderr();
  return outcome;
}

std::string readText(const std::filesystem::path& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

TEST(Program, MistakesAreOneLineAndExitCode2) {
  const sim2vr::testing::OwnFolder folder;
  std::ofstream(folder / "file") << "in the way of every folder below it";
  const std::string blocked = (folder / "file" / "x").string();
  const std::pair<std::vector<const char*>, const char*> mistakes[] = {
      {{"-simulated", "-port", "0"}, "-condition: got none next to -simulated"},
      {{"-port", "0", "-condition"}, "-condition: got no value"},
      {{"-port", "0", "-condition", "meduim"}, "did you mean 'medium'"},
      {{"--port", "0", "--game", "wackamole"}, "did you mean 'whacamole'"},
      {{"--port", "-1"}, "--port: got '-1', expected a whole number from 0 to 65535"},
      {{"--port", "0", "--width", "0"}, "--width: got '0', expected a whole number from 1 to 8192"},
      {{"--seconds", "-1"}, "--seconds: got '-1', expected a number above 0, at most 1e+09"},
      {{"--seconds", "abc"}, "--seconds: got 'abc', expected a number above 0"},
      {{"--port", "0", "--timeout", "1e300"}, "--timeout: got '1e300', expected a number above 0"},
      {{"--threads", "0"}, "--threads: got '0', expected a whole number from 1 to 256"},
      {{"--seed", "-1"}, "--seed: got '-1', expected a whole number from 0 to 4294967295"},
      {{"--port", "0", "--renderer", "vulkan"}, "renderer: got 'vulkan'"},
      {{"--port", "0", "--frame-time", "now"}, "--frame-time: got 'now'"},
      {{"--port", "0", "--bind", "192.0.2.1"}, "bind: got 'tcp://192.0.2.1:*'"},
      {{"--port", "0", "--log-dir", blocked.c_str()}, "log folder: got"},
      {{"--port", "0", "--record", blocked.c_str()}, "recording folder: got"},
      {{"--port", "0", "--log-file", blocked.c_str()}, "log file: got"},
      {{"--replay"}, "-stateLogFilepath: got none"},
      {{"--replay", "--state-log", "nosuch.csv"}, "state log: got 'nosuch.csv'"},
      {{"--log-level", "loud"}, "log level: got 'loud'"}};
  for (const auto& [words, message] : mistakes) {
    const Outcome outcome = runWith(words);
    EXPECT_EQ(outcome.code, kBadUsage) << message;
    EXPECT_NE(outcome.err.find(message), std::string::npos) << outcome.err;
    EXPECT_EQ(outcome.err.find("sim2vr-app: "), 0U) << outcome.err;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    EXPECT_EQ(outcome.out, "");
  }
}

TEST(Program, ServesUntilTheTimeOut) {
  const Outcome outcome =
      runWith({"-port", "0", "-condition", "easy", "--timeout", "0.05", "--renderer", "null"});
  EXPECT_EQ(outcome.code, kAbandoned);
  EXPECT_EQ(outcome.out.find("sim2vr-app: listening on tcp://127.0.0.1:"), 0U);
}

TEST(Program, LogsToAFile) {
  const sim2vr::testing::OwnFolder folder;
  const std::string file = (folder / "logs" / "app.log").string();
  const char* words[] = {"sim2vr-app", "-port", "0",        "--timeout",  "0.05",
                         "--renderer", "null",  "-logFile", file.c_str(), "-batchmode"};
  // In a process of its own: the log would stay where it was sent to.
  EXPECT_EXIT(std::exit(run(static_cast<int>(std::size(words)), words)),
              ::testing::ExitedWithCode(kAbandoned), "");
  const std::string log = readText(file);
  EXPECT_NE(log.find("timed out: no message received for 0.05 s"), std::string::npos) << log;
  EXPECT_NE(log.find("the argument -batchmode is not known"), std::string::npos) << log;
}

TEST(Program, ReplaysARecordedRound) {
  const auto recording = std::filesystem::path(SIM2VR_TEST_DATA_DIR) / "whacamole_round";
  const sim2vr::testing::OwnFolder folder;
  const std::string states = (recording / "states.csv").string();
  const Outcome outcome =
      runWith({"-replay", "-stateLogFilepath", states.c_str(), "-logging", "-outputFolder",
               folder.path().c_str(), "-record", "-resolution", "32x24", "--renderer", "null",
               "--options", R"({"round_seconds": 6})"});
  EXPECT_EQ(outcome.code, kSuccess) << outcome.err;
  EXPECT_NE(outcome.out.find("round over"), std::string::npos) << outcome.out;
  // The same hits at the same times as recorded.
  const auto hits = [](const std::string& events) {
    std::string found;
    for (std::size_t at = 0; (at = events.find("target_hit", at)) != std::string::npos; ++at) {
      found += events.substr(at, events.find(", velocity", at) - at) + "\n";
    }
    return found;
  };
  const std::string events = readText(folder / "logging" / "0000-hard" / "events.csv");
  EXPECT_NE(hits(events), "");
  EXPECT_EQ(hits(events), hits(readText(recording / "events.csv")));
  EXPECT_TRUE(exists(folder / "recording" / "mainCamera" / "image100.png"));
}

TEST(Program, ListsGamesAndItsVersion) {
  EXPECT_NE(runWith({"--list-games"}).out.find("whacamole\t"), std::string::npos);
  EXPECT_EQ(runWith({"--version"}).out.find("sim2vr-app "), 0U);
}

}  // namespace
}  // namespace sim2vr::program

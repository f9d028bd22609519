// SPDX-License-Identifier: Apache-2.0
// A short round of our own scripted player, kept as its log: the same poses and seed must give the
// same events again, in every build and version.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "game_harness.hpp"
#include "own_folder.hpp"
#include "sim2vr/games/registry.hpp"

namespace sim2vr::games {
namespace {

const std::filesystem::path kRecording =
    std::filesystem::path(SIM2VR_TEST_DATA_DIR) / "whacamole_round";

struct Event {
  double time_s = 0.0;
  std::string text;              // up to the velocity
  std::vector<double> velocity;  // empty without one
};

std::vector<Event> readEvents(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::vector<Event> events;
  for (std::string line; std::getline(file, line);) {
    Event event;
    event.time_s = std::stod(line);
    event.text = line.substr(line.find(", ") + 2);
    const std::size_t velocity = event.text.find(", velocity ");
    if (velocity != std::string::npos) {
      std::istringstream numbers(event.text.substr(velocity + 11));
      for (double v = 0.0; numbers >> v;) event.velocity.push_back(v);
      event.text.resize(velocity);
    }
    events.push_back(event);
  }
  return events;
}

// Row of states.csv: time, then left, right, head and marker, 7 numbers each.
testing::Poses readPoses(const std::string& row, double& time_s) {
  std::istringstream fields(row);
  std::vector<double> v;
  for (std::string field; std::getline(fields, field, ',');) v.push_back(std::stod(field));
  time_s = v.at(0);
  const auto pose = [&v](std::size_t i) {
    return Pose{Vec3(v.at(i), v.at(i + 1), v.at(i + 2)),
                Quat(v.at(i + 6), v.at(i + 3), v.at(i + 4), v.at(i + 5))};
  };
  return {pose(15), pose(8)};
}

TEST(RecordedRound, PosesAndSeedGiveTheSameEvents) {
  const sim2vr::testing::OwnFolder root;
  const auto game = createGame("whacamole");
  {
    rl::EpisodeLogger logger(root.path());
    testing::GameHarness round(*game, 42, R"({"condition": "hard", "round_seconds": 6})",
                               testing::referenceTime(), 0, &logger);
    std::ifstream states(kRecording / "states.csv");
    std::string row;
    std::getline(states, row);
    ASSERT_EQ(row, "condition hard, random seed 42");
    std::getline(states, row);
    while (std::getline(states, row)) {
      double time_s = 0.0;
      const testing::Poses poses = readPoses(row, time_s);
      const auto frame = std::llround(time_s / 0.05);
      round.frame(frame * 49'999'997, poses);
    }
    EXPECT_TRUE(round.env().finished());
  }
  const auto expected = readEvents(kRecording / "events.csv");
  const auto events = readEvents(root / "0000-hard" / "events.csv");
  ASSERT_EQ(events.size(), expected.size());
  for (std::size_t i = 0; i < events.size(); ++i) {
    EXPECT_NEAR(events[i].time_s, expected[i].time_s, 1e-5);
    EXPECT_EQ(events[i].text, expected[i].text);
    ASSERT_EQ(events[i].velocity.size(), expected[i].velocity.size());
    for (std::size_t j = 0; j < events[i].velocity.size(); ++j) {
      EXPECT_NEAR(events[i].velocity[j], expected[i].velocity[j], 1e-4);
    }
  }
}

}  // namespace
}  // namespace sim2vr::games

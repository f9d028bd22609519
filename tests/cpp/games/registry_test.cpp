// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "game_harness.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/games/registry.hpp"
#include "sim2vr/rl/xr_rig.hpp"

namespace sim2vr::games {
namespace {

TEST(Registry, ListsTheGames) {
  std::set<std::string> names;
  for (const rl::GameEntry& entry : registry()) {
    EXPECT_FALSE(entry.description.empty());
    EXPECT_EQ(createGame(entry.name)->name(), entry.name);
    EXPECT_TRUE(names.insert(entry.name).second) << entry.name << " twice";
  }
  EXPECT_TRUE(names.contains("whacamole"));
  EXPECT_TRUE(names.contains("sample"));
}

TEST(Registry, SuggestsTheNearestGame) {
  try {
    createGame("whackamole");
    FAIL();
  } catch (const InvalidArgument& error) {
    const std::string message = error.what();
    EXPECT_TRUE(message.starts_with("game: got 'whackamole', expected one of 'whacamole'"))
        << message;
    EXPECT_TRUE(message.ends_with("; did you mean 'whacamole'?")) << message;
  }
}

TEST(Registry, RefusesATimelineOfAGameWithoutLevels) {
  try {
    gameTimelineJson("sample", "{}", 1);
    FAIL();
  } catch (const InvalidArgument& error) {
    EXPECT_STREQ(error.what(), "game: got 'sample', expected a game with levels");
  }
}

// What the runtime relies on, for every game.
TEST(Registry, EveryGameHasAHeadCameraAndDefaults) {
  for (const rl::GameEntry& entry : registry()) {
    const auto game = entry.create();
    testing::GameHarness round(*game, 1);
    EXPECT_NE(round.scene().find(rl::kHeadCameraPath), nullptr) << entry.name;
    round.idle(3,
               {{Vec3(0.0, 1.2, 0.0), Quat::Identity()}, {Vec3(0.2, 0.8, 0.2), Quat::Identity()}});
    EXPECT_FALSE(round.env().finished()) << entry.name;
    // At its start, or 0 throughout in a game that does not tell.
    EXPECT_LE(round.env().timeFeature(), 0.0F) << entry.name;
  }
}

std::vector<std::string> publishedKeys(const nlohmann::json& facts) {
  std::vector<std::string> keys;
  const auto add = [&keys](const nlohmann::json& key, const nlohmann::json& grid) {
    if (key.is_null()) return;
    if (grid.is_null()) keys.push_back(key);
    const int items = grid.is_null() ? 0 : grid[0].get<int>() * grid[1].get<int>();
    for (int i = 0; i < items; ++i) keys.push_back(key.get<std::string>() + std::to_string(i));
  };
  for (const auto& measure : facts["measures"]) {
    add(measure["log_key"], measure["grid"]);
    add(measure["rate_with"], measure["grid"]);
    add(measure["only_if"], nullptr);
  }
  for (const auto& term : facts["reward_terms"]) {
    add(term["log_key"], nullptr);
    add(term["log_key"].get<std::string>() + rl::kSumSuffix, nullptr);
  }
  return keys;
}

TEST(Registry, EveryGameLogsWhatItPublishesInEveryCondition) {
  const Pose head{Vec3(0.0, 1.2, 0.0), Quat::Identity()};
  const Pose hand{Vec3(0.2, 0.8, 0.2), Quat::Identity()};
  std::set<std::string> ids;
  for (const rl::GameEntry& entry : registry()) {
    const auto facts = nlohmann::json::parse(gameFactsJson(entry.name));
    EXPECT_EQ(facts["name"], entry.name);
    EXPECT_TRUE(ids.insert(facts["id"].get<std::string>()).second) << entry.name;
    bool evaluated = false;
    for (const auto& condition : facts["conditions"]) {
      evaluated = evaluated || condition["evaluated"].get<bool>();
      EXPECT_FALSE(condition["description"].get<std::string>().empty()) << condition;
      nlohmann::json options = facts["evaluation_options"];
      options.update(condition["options"]);
      const auto game = entry.create();
      testing::GameHarness round(*game, 1, options.dump());
      round.idle(3, {head, hand});
      for (const std::string& key : publishedKeys(facts)) {
        EXPECT_TRUE(round.env().log().contains(key)) << entry.name << " " << key;
      }
    }
    EXPECT_TRUE(evaluated) << entry.name;
  }
  EXPECT_TRUE(ids.contains("WhacAMole"));
  EXPECT_TRUE(ids.contains("Sample"));
}

TEST(Registry, EveryGameNamesAnUnknownOption) {
  for (const rl::GameEntry& entry : registry()) {
    const auto game = entry.create();
    try {
      testing::GameHarness round(*game, 1, R"({"no such option": 1})");
      FAIL() << entry.name;
    } catch (const InvalidArgument& error) {
      EXPECT_NE(std::string(error.what()).find("unknown option 'no such option'"),
                std::string::npos)
          << error.what();
    }
  }
}

}  // namespace
}  // namespace sim2vr::games

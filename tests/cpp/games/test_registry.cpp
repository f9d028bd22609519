#include <gtest/gtest.h>

#include <set>
#include <string>

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

// What the runtime relies on, for every game.
TEST(Registry, EveryGameHasAHeadCameraAndDefaults) {
  for (const rl::GameEntry& entry : registry()) {
    const auto game = entry.create();
    testing::GameHarness round(*game, 1);
    EXPECT_NE(round.scene().find(rl::kHeadCameraPath), nullptr) << entry.name;
    round.idle(3,
               {{Vec3(0.0, 1.2, 0.0), Quat::Identity()}, {Vec3(0.2, 0.8, 0.2), Quat::Identity()}});
    EXPECT_FALSE(round.env().finished()) << entry.name;
    EXPECT_LT(round.env().GetTimeFeature(), -0.9F) << entry.name;
  }
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

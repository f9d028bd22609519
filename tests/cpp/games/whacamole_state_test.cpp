// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <string>

#include "sim2vr/core/errors.hpp"
#include "whacamole_player.hpp"

namespace sim2vr::games::whacamole {
namespace {

const std::string kOptions = R"({"condition": "hard", "round_seconds": 20})";

// One frame of a fixed motion that hits, touches and misses targets.
void wave(testing::GameHarness& harness, int n) {
  const double t = n * 0.05;
  const Vec3 head(0.15 + 0.12 * std::sin(1.3 * t), 1.1 + 0.12 * std::sin(0.9 * t),
                  0.36 + 0.12 * std::sin(9.0 * t));
  harness.frame(n * WhacAMoleRound::kPeriod_ns,
                {{Vec3(0, 1.2, 0), Quat::Identity()}, controllerForRoot(head - kHammerToHead_m)});
}

TEST(WhacAMoleState, SeedAndInputFixTheRound) {
  WhacAMole game_a;
  WhacAMole game_b;
  WhacAMole game_c;
  testing::GameHarness a(game_a, 5, kOptions);
  testing::GameHarness b(game_b, 5, kOptions);
  testing::GameHarness c(game_c, 6, kOptions);
  for (int n = 0; n < 300; ++n) {
    wave(a, n);
    wave(b, n);
    wave(c, n);
    ASSERT_EQ(a.env().reward(), b.env().reward());
  }
  EXPECT_GT(a.log("Points"), 0.0);
  EXPECT_GT(a.log("Contacts"), 0.0);
  EXPECT_GT(a.log("Misses"), 0.0);
  EXPECT_EQ(a.save(), b.save());
  EXPECT_NE(a.save(), c.save());
}

TEST(WhacAMoleState, LoadedStateGoesOnBitForBit) {
  for (const int save_at : {1, 40, 101, 173}) {
    WhacAMole game;
    testing::GameHarness original(game, 5, kOptions);
    for (int n = 0; n < save_at; ++n) wave(original, n);
    const std::string state = original.save();
    Archive tally = Archive::saver();
    game.fields(tally);

    WhacAMole other;
    testing::GameHarness copy(other, 5, kOptions);
    for (int n = 0; n < 77; ++n) wave(copy, n);  // a different past
    WhacAMole loaded_game;
    testing::GameHarness loaded(loaded_game, 5, kOptions);
    for (testing::GameHarness* target : {&copy, &loaded}) {
      WhacAMole& its_game = target == &copy ? other : loaded_game;
      Archive loader = Archive::loader(tally.bytes());
      its_game.fields(loader);
      target->load(state);
      EXPECT_EQ(target->save(), state) << "at frame " << save_at;
    }
    for (int n = save_at; n < save_at + 120; ++n) {
      wave(original, n);
      wave(copy, n);
      wave(loaded, n);
      ASSERT_EQ(copy.env().reward(), original.env().reward()) << n;
      ASSERT_EQ(loaded.env().reward(), original.env().reward()) << n;
    }
    EXPECT_EQ(copy.env().log(), original.env().log());
    EXPECT_EQ(copy.save(), original.save());
    EXPECT_EQ(loaded.save(), original.save());
  }
}

TEST(WhacAMoleState, RefusesTruncatedBytes) {
  WhacAMole game;
  testing::GameHarness round(game, 5, kOptions);
  for (int n = 0; n < 10; ++n) wave(round, n);
  std::string state = round.save();
  state.resize(state.size() / 2);
  EXPECT_THROW(round.load(state), EngineError);
}

}  // namespace
}  // namespace sim2vr::games::whacamole

// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <vector>

#include "whacamole/round.hpp"

namespace sim2vr::games::whacamole {
namespace {

// The reference's draws for one spawn, written out: pause, size, shuffle of the free list, life.
int expectedCell(Random& random, std::vector<int>& free, float time_s, float& pause_end_s) {
  pause_end_s = time_s + random.range(0.0F, 0.5F);
  random.next();
  for (int i = 0; i + 1 < static_cast<int>(free.size()); ++i) {
    const int j = i + static_cast<int>(random.next() % static_cast<std::uint32_t>(free.size() - i));
    std::swap(free[static_cast<std::size_t>(i)], free[static_cast<std::size_t>(j)]);
  }
  const int cell = free.front();
  free.erase(free.begin());
  random.next();
  return cell;
}

TEST(Spawner, DrawsInTheReferencesOrder) {
  Spawner spawner(859190, {});
  Random random(859190);
  std::vector<int> free{0, 3, 6, 1, 4, 7, 2, 5, 8};
  float pause_end_s = 0.0F;
  for (int n = 0; n < 6; ++n) {
    const float time_s = static_cast<float>(n + 1);
    const auto spawn = spawner.next(time_s, 0, 5);
    ASSERT_TRUE(spawn);
    EXPECT_EQ(spawn->id, n);
    EXPECT_EQ(spawn->cell, expectedCell(random, free, time_s, pause_end_s));
    if (n == 3) {
      spawner.release(spawn->cell);
      free.push_back(spawn->cell);
    }
  }
}

TEST(Spawner, WaitsForThePauseAndTheMaximum) {
  Spawner spawner(1, {});
  Random random(1);
  std::vector<int> free{0, 3, 6, 1, 4, 7, 2, 5, 8};
  float pause_end_s = 0.0F;
  EXPECT_FALSE(spawner.next(0.0F, 0, 3));  // the time must lie after the pause's end, 0 at first
  EXPECT_FALSE(spawner.next(0.1F, 3, 3));
  ASSERT_TRUE(spawner.next(0.1F, 2, 3));
  expectedCell(random, free, 0.1F, pause_end_s);
  EXPECT_FALSE(spawner.next(pause_end_s, 0, 3));
  EXPECT_TRUE(spawner.next(std::nextafter(pause_end_s, 10.0F), 0, 3));
}

TEST(Spawner, NeverUsesAnOccupiedCell) {
  Spawner spawner(3, {});
  std::vector<int> taken;
  for (int n = 0; n < kCells; ++n) {
    const auto spawn = spawner.next(static_cast<float>(n + 1), n, 100);
    ASSERT_TRUE(spawn);
    EXPECT_EQ(std::count(taken.begin(), taken.end(), spawn->cell), 0);
    taken.push_back(spawn->cell);
  }
  EXPECT_FALSE(spawner.next(100.0F, 9, 100));
}

// Whatever lives and however short the pause: a list is a list.
TEST(Spawner, FollowsASchedule) {
  Spawner spawner(1, {}, {{0.1F, 4}, {0.1F, 4}, {0.35F, 8}});
  EXPECT_FALSE(spawner.next(0.099999F, 0, 1));
  for (int id = 0; id < 2; ++id) {
    const auto spawn = spawner.next(0.1F, 7, 1);
    ASSERT_TRUE(spawn);
    EXPECT_EQ(spawn->id, id);
    EXPECT_EQ(spawn->cell, 4);
  }
  EXPECT_FALSE(spawner.next(0.3F, 0, 1));
  EXPECT_EQ(spawner.next(0.4F, 0, 1)->cell, 8);
  EXPECT_FALSE(spawner.next(100.0F, 0, 1));
}

TEST(AdaptiveWeights, AddTheMeanFailRate) {
  // One cell always fails: mean 1/9, so its weight is 10/9 against 1/9 for each other.
  std::array<double, kCells> rates{};
  rates[4] = 1.0;
  const CellWeights weights = adaptiveWeights(rates);
  ASSERT_EQ(weights.size(), 9U);
  EXPECT_FLOAT_EQ(weights[4], 10.0F / 9.0F);
  EXPECT_FLOAT_EQ(weights[0], 1.0F / 9.0F);
  EXPECT_TRUE(adaptiveWeights({}).empty());
}

TEST(AdaptiveWeights, ShiftTheSpawns) {
  std::array<double, kCells> rates{};
  rates[4] = 1.0;
  int hard_cell = 0;
  for (std::uint32_t seed = 0; seed < 900; ++seed) {
    Spawner spawner(seed * 7919U, adaptiveWeights(rates));
    if (spawner.next(1.0F, 0, 1)->cell == 4) ++hard_cell;
  }
  EXPECT_NEAR(hard_cell, 500, 60);  // 10 of 18 parts
}

TEST(Spawner, SavedStateGoesOnTheSame) {
  Spawner spawner(5, {});
  spawner.next(1.0F, 0, 5);
  Archive saver = Archive::saver();
  spawner.fields(saver);
  Spawner copy(99, {});
  Archive loader = Archive::loader(saver.bytes());
  copy.fields(loader);
  for (int n = 2; n < 6; ++n) {
    const auto time_s = static_cast<float>(n);
    const auto a = spawner.next(time_s, 0, 5);
    const auto b = copy.next(time_s, 0, 5);
    ASSERT_TRUE(a && b);
    EXPECT_EQ(a->id, b->id);
    EXPECT_EQ(a->cell, b->cell);
  }
}

}  // namespace
}  // namespace sim2vr::games::whacamole

// SPDX-License-Identifier: Apache-2.0
// The generator against numbers computed independently (arbitrary-precision integers), and against
// rounds that the original application recorded.
#include "sim2vr/core/random.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "sim2vr/core/errors.hpp"

namespace sim2vr {
namespace {

std::vector<std::uint32_t> draw(std::uint32_t seed, int count) {
  Random random(seed);
  std::vector<std::uint32_t> values;
  for (int i = 0; i < count; ++i) values.push_back(random.next());
  return values;
}

TEST(Random, FirstValuesOfKnownSeeds) {
  using Values = std::vector<std::uint32_t>;
  EXPECT_EQ(draw(0, 6),
            (Values{1900725526U, 1900725046U, 559298752U, 107093222U, 556206921U, 106114856U}));
  EXPECT_EQ(draw(1, 6),
            (Values{3690984874U, 2346916618U, 2899782266U, 2285563962U, 2890667570U, 1071936506U}));
  EXPECT_EQ(draw(13259, 6),
            (Values{586679922U, 3235060199U, 3915092919U, 4120728357U, 397676658U, 1341140802U}));
  EXPECT_EQ(draw(4294967295U, 6),
            (Values{110471304U, 1451848272U, 305508131U, 3111582328U, 302830646U, 252329941U}));
}

TEST(Random, IntegerRangeIsLowPlusRemainder) {
  Random random(13259);
  EXPECT_EQ(random.range(0, 9), static_cast<int>(586679922U % 9U));
  EXPECT_EQ(random.range(-5, 5), -5 + static_cast<int>(3235060199U % 10U));
  EXPECT_EQ(random.range(7, 8), 7);
}

TEST(Random, FloatRangeIsMirroredAndFrom23Bits) {
  // Low 23 bits of the first values of seed 13259: 7865970 and 5446119 (of 8388607).
  Random random(13259);
  EXPECT_FLOAT_EQ(random.range(0.0F, 0.5F), 0.5F * (1.0F - 7865970.0F / 8388607.0F));
  const float q = 5446119.0F / 8388607.0F;
  EXPECT_EQ(random.range(10.0F, 20.0F), q * 10.0F + (1.0F - q) * 20.0F);
  EXPECT_FLOAT_EQ(random.range(0.025F, 0.025F), 0.025F);
}

TEST(Random, EmptyIntegerRangeIsRefused) {
  Random random;
  try {
    random.range(3, 3);
    FAIL() << "no error";
  } catch (const InvalidArgument& error) {
    EXPECT_STREQ(error.what(), "high: got 3, expected an integer above low = 3");
  }
}

TEST(Random, ShuffleSwapsForward) {
  // Seed 0: positions 0 + 1900725526 % 3 = 1 and 1 + 1900725046 % 2 = 1.
  Random random(0);
  std::vector<char> items{'a', 'b', 'c'};
  random.shuffle(items);
  EXPECT_EQ(items, (std::vector<char>{'b', 'a', 'c'}));
}

TEST(Random, StateContinuesAfterLoad) {
  Random random(77);
  random.next();
  Archive saved = Archive::saver();
  random.fields(saved);
  Random other(1);
  Archive loader = Archive::loader(saved.bytes());
  other.fields(loader);
  for (int i = 0; i < 8; ++i) EXPECT_EQ(other.next(), random.next());
}

// One spawn of a recorded round: the cell, and the cells freed since the spawn before.
struct RecordedSpawn {
  int cell;
  std::vector<int> freed_before;
};

void expectRound(std::uint32_t seed, const std::vector<RecordedSpawn>& spawns) {
  Random random(seed);
  std::vector<int> free_cells{0, 3, 6, 1, 4, 7, 2, 5, 8};
  for (std::size_t i = 0; i < spawns.size(); ++i) {
    const auto& freed = spawns[i].freed_before;
    free_cells.insert(free_cells.end(), freed.begin(), freed.end());
    random.range(0.0F, 0.5F);      // pause until the next spawn
    random.range(0.025F, 0.025F);  // size
    random.shuffle(free_cells);
    EXPECT_EQ(free_cells.front(), spawns[i].cell) << "seed " << seed << ", spawn " << i;
    free_cells.erase(free_cells.begin());
    random.range(1.0F, 1.0F);  // life
  }
}

TEST(Random, ReproducesTheCellsOfARecordedEasyRound) {
  expectRound(13259, {{1, {}},
                      {5, {1}},
                      {5, {5}},
                      {2, {5}},
                      {7, {2}},
                      {8, {7}},
                      {5, {8}},
                      {1, {5}},
                      {1, {1}},
                      {8, {1}}});
}

TEST(Random, ReproducesTheCellsOfARecordedMediumRound) {
  expectRound(116911, {{5, {}},
                       {4, {}},
                       {1, {}},
                       {7, {1}},
                       {0, {4, 5}},
                       {5, {7}},
                       {8, {}},
                       {3, {0}},
                       {6, {5, 8}},
                       {8, {}}});
}

}  // namespace
}  // namespace sim2vr

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/archive.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "sim2vr/core/errors.hpp"

namespace sim2vr {
namespace {

enum class Phase { ready, play };

struct Item {
  int number = 0;
  std::string word;
  void fields(Archive& archive) {
    archive.field("number", number);
    archive.field("word", word);
  }
};

struct Everything {
  bool flag = false;
  std::int64_t time_ns = 0;
  float score = 0.0F;
  Phase phase = Phase::ready;
  std::string text;
  Vec3 vector = Vec3::Zero();
  Pose pose;
  std::array<int, 2> pair_of_ints{};
  std::vector<Item> items;
  std::vector<bool> bits;
  std::optional<Item> maybe;
  std::optional<int> nothing = 5;
  std::map<std::string, double> table;
  std::pair<int, std::string> couple;

  void fields(Archive& archive) {
    archive.field("flag", flag);
    archive.field("time_ns", time_ns);
    archive.field("score", score);
    archive.field("phase", phase, Phase::play);
    archive.field("text", text);
    archive.field("vector", vector);
    archive.field("pose", pose);
    archive.field("pair_of_ints", pair_of_ints);
    archive.field("items", items);
    archive.field("bits", bits);
    archive.field("maybe", maybe);
    archive.field("nothing", nothing);
    archive.field("table", table);
    archive.field("couple", couple);
  }
};

Everything example() {
  Everything e;
  e.flag = true;
  e.time_ns = -123456789012345;
  e.score = 0.1F;
  e.phase = Phase::play;
  e.text = std::string("nul \0 inside", 12);
  e.vector = Vec3(1.0, -2.5, 1e-300);
  e.pose = {Vec3(4, 5, 6), Quat(0.5, -0.5, 0.5, -0.5)};
  e.pair_of_ints = {7, 8};
  e.items = {{1, "one"}, {2, ""}};
  e.bits = {true, false, true};
  e.maybe = Item{3, "three"};
  e.nothing.reset();
  e.table = {{"a", 1.5}, {"b", -0.0}};
  e.couple = {9, "nine"};
  return e;
}

std::string save(Everything& e) {
  Archive archive = Archive::saver();
  e.fields(archive);
  return archive.bytes();
}

template <class T>
std::string loadError(const std::string& bytes, T& into) {
  try {
    Archive archive = Archive::loader(bytes);
    into.fields(archive);
    archive.expectEnd();
  } catch (const EngineError& error) {
    return error.what();
  }
  return "none";
}

TEST(Archive, RoundTripRestoresEveryKindOfValue) {
  Everything original = example();
  const std::string bytes = save(original);
  Everything loaded;
  ASSERT_EQ(loadError(bytes, loaded), "none");
  EXPECT_TRUE(loaded.flag);
  EXPECT_EQ(loaded.time_ns, -123456789012345);
  EXPECT_EQ(loaded.score, 0.1F);
  EXPECT_EQ(loaded.phase, Phase::play);
  EXPECT_EQ(loaded.text, std::string("nul \0 inside", 12));
  EXPECT_EQ(loaded.vector, Vec3(1.0, -2.5, 1e-300));
  EXPECT_EQ(loaded.pose.position, Vec3(4, 5, 6));
  EXPECT_EQ(loaded.pose.rotation.coeffs(), Quat(0.5, -0.5, 0.5, -0.5).coeffs());
  EXPECT_EQ(loaded.pair_of_ints, (std::array<int, 2>{7, 8}));
  ASSERT_EQ(loaded.items.size(), 2U);
  EXPECT_EQ(loaded.items[0].word, "one");
  EXPECT_EQ(loaded.items[1].number, 2);
  EXPECT_EQ(loaded.bits, (std::vector<bool>{true, false, true}));
  ASSERT_TRUE(loaded.maybe.has_value());
  EXPECT_EQ(loaded.maybe->word, "three");
  EXPECT_FALSE(loaded.nothing.has_value());
  EXPECT_EQ(loaded.table.at("a"), 1.5);
  EXPECT_EQ(loaded.couple.second, "nine");
  EXPECT_EQ(save(loaded), bytes);
}

// name length, name, value: little endian.
TEST(Archive, BytesOfOneField) {
  Archive archive = Archive::saver();
  std::uint16_t value = 0x0201;
  archive.field("ab", value);
  EXPECT_EQ(archive.bytes(), std::string("\x02"
                                         "ab"
                                         "\x01\x02",
                                         5));
}

// Published FNV-1a test vectors: "" and "a" (here: a field with an empty name would add a byte, so
// the vectors are reached through a loader).
TEST(Archive, HashIsFnv1a) {
  EXPECT_EQ(Archive::saver().hash(), 0xcbf29ce484222325ULL);
  EXPECT_EQ(Archive::loader("a").hash(), 0xaf63dc4c8601ec8cULL);
  EXPECT_EQ(Archive::loader("foobar").hash(), 0x85944171f73967e8ULL);
}

TEST(Archive, EveryTruncationIsRefused) {
  Everything original = example();
  const std::string bytes = save(original);
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    Everything loaded;
    EXPECT_NE(loadError(bytes.substr(0, size), loaded), "none") << size << " bytes";
  }
}

TEST(Archive, AnotherLayoutIsRefusedByName) {
  Item item{1, "x"};
  Archive archive = Archive::saver();
  item.fields(archive);
  struct Other {
    int count = 0;
    void fields(Archive& a) { a.field("count", count); }
  } other;
  EXPECT_EQ(loadError(archive.bytes(), other),
            "saved state: expected the field 'count' at byte 0; it is damaged or was made by "
            "another game or version");
}

TEST(Archive, LeftOverBytesAreRefused) {
  Everything original = example();
  Everything loaded;
  EXPECT_EQ(loadError(save(original) + "xyz", loaded),
            "saved state: 3 bytes left over; it was made by another game or version");
}

TEST(Archive, DamagedCountDoesNotAskForMemory) {
  struct Numbers {
    std::vector<double> values{1.0, 2.0};
    void fields(Archive& a) { a.field("v", values); }
  } numbers;
  Archive archive = Archive::saver();
  numbers.fields(archive);
  std::string bytes = archive.bytes();
  bytes[2 + 7] = '\x7f';  // highest byte of the count
  const std::string error = loadError(bytes, numbers);
  EXPECT_NE(error.find("exceeds the bytes left"), std::string::npos) << error;
}

// As many as the bytes left, of which each element takes nine.
TEST(Archive, DamagedCountMakesNoMoreElementsThanTheBytesHold) {
  static int made = 0;
  struct Large {
    Large() { ++made; }
    double value = 0.0;
    std::array<char, 1000> more{};
    void fields(Archive& a) { a.field("", value); }
  };
  struct Larges {
    std::vector<Large> values;
    void fields(Archive& a) { a.field("v", values); }
  } larges;
  std::string bytes = "\x01v";
  bytes.append(8 + 9 * 1000, '\0');
  const std::uint64_t damaged = 9 * 1000;
  std::memcpy(bytes.data() + 2, &damaged, sizeof(damaged));
  EXPECT_EQ(loadError(bytes, larges),
            "saved state: expected the field '' at byte 9010; it is damaged or was made by another "
            "game or version");
  EXPECT_EQ(made, 1001);
}

TEST(Archive, AnEnumeratorThatThereIsNotIsRefused) {
  struct State {
    Phase phase = Phase::play;
    void fields(Archive& a) { a.field("phase", phase, Phase::play); }
  } state;
  Archive archive = Archive::saver();
  state.fields(archive);
  for (const int damaged : {2, -1}) {
    std::string bytes = archive.bytes();
    std::memcpy(bytes.data() + 6, &damaged, sizeof(damaged));
    EXPECT_EQ(loadError(bytes, state),
              "saved state: field 'phase': got " + std::to_string(damaged) + ", expected 0 to 1");
  }
}

TEST(Archive, BytesOfAnotherOrderAreRefused) {
  Archive archive = Archive::saver();
  archive.byteOrder();
  struct Order {
    void fields(Archive& a) { a.byteOrder(); }
  } order;
  EXPECT_EQ(loadError(archive.bytes(), order), "none");
  std::string bytes = archive.bytes();
  std::reverse(bytes.end() - 4, bytes.end());
  EXPECT_EQ(loadError(bytes, order),
            "saved state: made on a machine with another byte order, expected little endian");
}

TEST(Archive, DamagedBoolIsRefused) {
  struct Flag {
    bool up = true;
    void fields(Archive& a) { a.field("up", up); }
  } flag;
  Archive archive = Archive::saver();
  flag.fields(archive);
  std::string bytes = archive.bytes();
  bytes.back() = 50;
  EXPECT_EQ(loadError(bytes, flag), "saved state: got 50 at byte 3, expected true or false");
}

TEST(Archive, NumbersOutOfTheirRangeAreRefusedByName) {
  struct Counted {
    int score = 5;
    std::array<double, 2> shares{0.5, 1.0};
    void fields(Archive& a) {
      a.field("score", score, kCounts);
      a.field("shares", shares, {0.0, 1.0});
    }
  };
  const auto errorWith = [](Counted crafted) {
    Archive archive = Archive::saver();
    crafted.fields(archive);
    return loadError(archive.bytes(), crafted);
  };
  EXPECT_EQ(errorWith({.score = std::numeric_limits<int>::max()}),
            "saved state: field 'score': got 2147483647, expected 0 to 1000000000");
  EXPECT_EQ(errorWith({.score = -1}),
            "saved state: field 'score': got -1, expected 0 to 1000000000");
  EXPECT_EQ(errorWith({.shares = {0.0, std::nan("")}}),
            "saved state: field 'shares': got nan, expected 0 to 1");
}

TEST(Archive, DamagedNameIsRefused) {
  Everything original = example();
  std::string bytes = save(original);
  const std::size_t place = bytes.find("pair_of_ints");
  ASSERT_NE(place, std::string::npos);
  bytes[place] = 'q';
  Everything loaded;
  EXPECT_NE(loadError(bytes, loaded).find("expected the field 'pair_of_ints'"), std::string::npos);
}

}  // namespace
}  // namespace sim2vr

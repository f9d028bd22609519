// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/errors.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "sim2vr/core/log.hpp"
#include "sim2vr/core/version.hpp"

namespace sim2vr {
namespace {

const std::vector<std::string> kNames{"whacamole", "beats", "sample"};

TEST(Errors, MessageNamesFieldGotAndExpected) {
  const InvalidArgument error("radius_m", "-1", "a positive number");
  EXPECT_STREQ(error.what(), "radius_m: got -1, expected a positive number");
  EXPECT_EQ(error.field(), "radius_m");
}

// Whatever a file or a message held, the sentence is one line, and all of it.
TEST(Errors, ControlCharactersAreSpeltOut) {
  const std::string got("a\nb\0c\x1b[31m\x7f", 11);
  const InvalidArgument error("options", got, "a JSON object");
  EXPECT_STREQ(error.what(), R"(options: got a\nb\u0000c\u001b[31m\u007f, expected a JSON object)");
  EXPECT_EQ(error.got(), got);
}

TEST(Errors, FamiliesAreCaughtByTheirBase) {
  EXPECT_THROW(throw StateError("x"), EngineError);
  EXPECT_THROW(throw RenderError("x"), EngineError);
  EXPECT_THROW(throw InvalidArgument("a", "b", "c"), std::invalid_argument);
}

TEST(Errors, SuggestsTheNearestOrNothing) {
  EXPECT_EQ(didYouMean("whackamole", kNames), "; did you mean 'whacamole'?");
  EXPECT_EQ(didYouMean("beat", kNames), "; did you mean 'beats'?");
  EXPECT_EQ(didYouMean("tetris", {}), "");
  EXPECT_EQ(didYouMean("xyzzy", kNames), "");
}

TEST(Errors, ListsChoices) {
  EXPECT_EQ(listChoices(kNames), "'whacamole', 'beats' or 'sample'");
  EXPECT_EQ(listChoices(std::vector<std::string>{"one"}), "'one'");
  EXPECT_EQ(listChoices({}), "");
}

TEST(Errors, OfManyNamesOnlyTheNearOneIsListed) {
  EXPECT_EQ(oneOf(kNames, "beat"),
            "one of 'whacamole', 'beats' or 'sample'; did you mean 'beats'?");
  std::vector<std::string> many;
  for (char letter = 'a'; letter <= 'm'; ++letter) many.push_back(std::string(6, letter));
  EXPECT_EQ(oneOf(many, "eeeee"), "one of 13 names; did you mean 'eeeeee'?");
  EXPECT_EQ(oneOf(many, "xyzxyz"), "one of " + listChoices(many));
  many.pop_back();
  EXPECT_EQ(oneOf(many, "eeeee"), "one of " + listChoices(many) + "; did you mean 'eeeeee'?");
}

TEST(Log, UnknownLevelIsRefused) {
  try {
    setLogLevel("loud");
    FAIL() << "no error";
  } catch (const InvalidArgument& error) {
    EXPECT_STREQ(error.what(),
                 "log level: got 'loud', expected 'trace', 'debug', 'info', 'warning', 'error' or "
                 "'off'");
  }
  setLogLevel("warning");
}

TEST(Version, HasThreeNumbers) {
  const std::string text(version());
  int dots = 0;
  for (const char c : text) dots += c == '.' ? 1 : 0;
  EXPECT_EQ(dots, 2) << text;
}

}  // namespace
}  // namespace sim2vr

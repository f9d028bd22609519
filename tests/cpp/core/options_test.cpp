// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/options.hpp"
#include "error_of.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "sim2vr/core/errors.hpp"

namespace sim2vr {
namespace {

const std::vector<std::string> kChoices{"easy", "medium", "hard"};

TEST(Options, ReadsValuesAndFallsBack) {
  Options options = Options::fromJson(
      R"({"condition": "hard", "adaptive": true, "reward_scale": 2.5, "user": "a \"b\""})");
  EXPECT_EQ(options.getChoice("condition", "medium", kChoices), "hard");
  EXPECT_EQ(options.getChoice("other", "medium", kChoices), "medium");
  EXPECT_TRUE(options.getBool("adaptive", false));
  EXPECT_TRUE(options.getBool("sound", true));
  EXPECT_EQ(options.getNumber("reward_scale", 1.0, 0.0, 10.0), 2.5);
  EXPECT_EQ(options.getNumber("rate", 0.25, 0.0, 1.0), 0.25);
  EXPECT_EQ(options.getString("user", ""), "a \"b\"");
  EXPECT_TRUE(options.has("user"));
  EXPECT_FALSE(options.has("sound"));
  options.expectAllRead();
}

TEST(Options, DescribesWhatWasRead) {
  Options options;
  options.getChoice("condition", "medium", kChoices);
  options.getBool("adaptive", false);
  options.getNumber("reward_scale", 1.5, 0.0, 10.0);
  options.getNumbers("times", 0.0, 9.0);
  options.getString("level", "first");
  EXPECT_EQ(options.describe(),
            R"([{"default":false,"name":"adaptive","type":"bool"},)"
            R"({"choices":["easy","medium","hard"],"default":"medium","name":"condition",)"
            R"("type":"choice"},{"default":"first","name":"level","type":"text"},)"
            R"({"default":1.5,"maximum":10.0,"minimum":0.0,"name":"reward_scale",)"
            R"("type":"number"},{"default":[],"maximum":9.0,"minimum":0.0,"name":"times",)"
            R"("type":"numbers"}])");
}

TEST(Options, WrongTypeNamesTheOption) {
  Options options = Options::fromJson(R"({"s": 1, "b": "yes", "n": true, "big": 11})");
  EXPECT_EQ(errorOf([&] { options.getString("s", ""); }), "option 's': got 1, expected a string");
  EXPECT_EQ(errorOf([&] { options.getBool("b", false); }),
            "option 'b': got \"yes\", expected true or false");
  EXPECT_EQ(errorOf([&] { options.getNumber("n", 0.0, 0.0, 10.0); }),
            "option 'n': got true, expected a number from 0.0 to 10.0");
  EXPECT_EQ(errorOf([&] { options.getNumber("big", 0.0, 0.0, 10.0); }),
            "option 'big': got 11, expected a number from 0.0 to 10.0");
}

TEST(Options, WrongChoiceSuggestsTheNearest) {
  Options options = Options::fromJson(R"({"condition": "meduim"})");
  EXPECT_EQ(errorOf([&] { options.getChoice("condition", "easy", kChoices); }),
            "option 'condition': got 'meduim', expected one of 'easy', 'medium' or 'hard'; did you "
            "mean 'medium'?");
}

TEST(Options, UnknownOptionSuggestsAKnownName) {
  Options options = Options::fromJson(R"({"conditon": "easy"})");
  options.getChoice("condition", "easy", kChoices);
  options.getBool("adaptive", false);
  EXPECT_EQ(
      errorOf([&] { options.expectAllRead(); }),
      "options: got unknown option 'conditon', expected one of 'adaptive' or 'condition'; did "
      "you mean 'condition'?");
}

TEST(Options, ListsOfNumbers) {
  Options options = Options::fromJson(R"({"times": [0, 1.5, 3], "one": 2, "cells": [1, 9, "x"]})");
  EXPECT_EQ(options.getNumbers("times", 0.0, 10.0), (std::vector<double>{0.0, 1.5, 3.0}));
  EXPECT_TRUE(options.getNumbers("absent", 0.0, 1.0).empty());
  EXPECT_EQ(errorOf([&] { options.getNumbers("one", 0.0, 10.0); }),
            "option 'one': got 2, expected a list of numbers");
  EXPECT_EQ(errorOf([&] { options.getNumbers("cells", 0.0, 8.0); }),
            "option 'cells'[1]: got 9, expected a number from 0.0 to 8.0");
  EXPECT_EQ(errorOf([&] { options.getNumbers("cells", 0.0, 10.0); }),
            "option 'cells'[2]: got \"x\", expected a number from 0.0 to 10.0");
}

TEST(Options, MergingAddsAndReplaces) {
  EXPECT_EQ(mergedOptions(R"({"a": 1, "b": {"x": 1}})", R"({"b": {"y": 2}, "c": 3})"),
            R"({"a":1,"b":{"y":2},"c":3})");
  EXPECT_EQ(errorOf([] { mergedOptions("{}", "[1]"); }),
            "options: got '[1]', expected a JSON object");
}

TEST(Options, OnlyAnObjectIsAccepted) {
  EXPECT_EQ(errorOf([] { Options::fromJson("[1, 2]"); }),
            "options: got '[1, 2]', expected a JSON object");
  EXPECT_EQ(errorOf([] { Options::fromJson("{broken"); }),
            "options: got '{broken', expected a JSON object");
  EXPECT_EQ(errorOf([] { Options::fromJson(""); }), "options: got '', expected a JSON object");
  EXPECT_EQ(errorOf([] { Options::fromJson("{\"a\": \"\xff\"}"); }).substr(0, 13), "options: got ");
  EXPECT_EQ(errorOf([] { Options::fromJson("{}").expectAllRead(); }), "none");
}

}  // namespace
}  // namespace sim2vr

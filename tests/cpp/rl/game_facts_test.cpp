// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/rl/game_facts.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::rl {
namespace {

TEST(GameFacts, AGameThatSaysNothingHasOneConditionAndItsReward) {
  const auto facts = nlohmann::json::parse(factsJson("my_game", "A game", {}));
  EXPECT_EQ(facts["name"], "my_game");
  EXPECT_EQ(facts["id"], "MyGame");
  EXPECT_TRUE(facts["measures"].empty());
  EXPECT_TRUE(facts["score"].is_null());
  ASSERT_EQ(facts["conditions"].size(), 1U);
  EXPECT_EQ(facts["conditions"][0]["name"], facts["default_condition"]);
  EXPECT_TRUE(facts["conditions"][0]["options"].empty());
  EXPECT_TRUE(facts["conditions"][0]["evaluated"]);
}

TEST(GameFacts, ItemsSayWhatTheLogCallsThem) {
  GameFacts facts;
  facts.items = {{.name = "coin", .id_field = "ID", .outcomes = {{"coin_taken", "taken", true}}}};
  const auto observed = nlohmann::json::parse(factsJson("g", "", facts))["items"];
  EXPECT_EQ(observed,
            nlohmann::json::parse(R"([{"name": "coin", "id_field": "ID", "begin_event": null,
      "outcomes": [{"event": "coin_taken", "name": "taken", "success": true}],
      "counted_events": [], "cell_field": null, "place_field": null, "places_event": null,
      "velocity_field": null}])"));
}

TEST(GameFacts, TheDefaultConditionIsEvaluatedWhenNoneIsNamed) {
  GameFacts facts;
  facts.conditions = {{.name = "a", .options_json = R"({"x": 1})"},
                      {.name = "b", .options_json = R"({"x": 2})"}};
  facts.default_condition = "b";
  const auto observed = nlohmann::json::parse(factsJson("g", "", facts));
  EXPECT_FALSE(observed["conditions"][0]["evaluated"]);
  EXPECT_TRUE(observed["conditions"][1]["evaluated"]);
}

std::string refusal(const GameFacts& facts) {
  try {
    factsJson("g", "", facts);
  } catch (const InvalidArgument& error) {
    return error.what();
  }
  return "";
}

TEST(GameFacts, ContradictionsAreNamed) {
  GameFacts facts;
  facts.measures = {{.name = "hits", .label = "Hits", .log_key = "Points"}};
  facts.score = "hit";
  EXPECT_EQ(refusal(facts), "score: got 'hit', expected the name of a measure, no grid");
  facts.score = "hits";
  EXPECT_EQ(refusal(facts), "");
  facts.measures.push_back(facts.measures[0]);
  EXPECT_EQ(refusal(facts), "measures: got 'hits' twice, expected every name once");
  facts.devices = {"controler_left"};
  EXPECT_EQ(refusal(facts),
            "devices: got 'controler_left', expected 'controller_right' or 'controller_left'");
  facts.devices = {};
  facts.measures = {{.name = "hits", .label = "Hits"}};
  EXPECT_EQ(refusal(facts), "measures: got 'hits', expected a name, a label and a log_key");
  facts.measures = {};
  facts.score = "";
  facts.items = {{.name = "coin", .id_field = "ID"}};
  EXPECT_EQ(refusal(facts), "items: got 'coin', expected a name, an id_field and outcomes");

  GameFacts other;
  other.conditions = {{.name = "a", .options_json = R"({"x": 1})"},
                      {.name = "b", .options_json = R"({"y": 2})"}};
  other.default_condition = "a";
  EXPECT_EQ(refusal(other),
            "conditions: got 'b', which sets other options, expected conditions that all set the "
            "same options");
  other.conditions[1] = {.name = "b", .options_json = R"({"x": 2})", .draws = {"c"}};
  EXPECT_EQ(refusal(other), "draws: got 'c', expected the name of a condition");
  other.conditions[1].draws = {"a"};
  other.default_condition = "d";
  EXPECT_EQ(refusal(other), "default_condition: got 'd', expected the name of a condition");
}

}  // namespace
}  // namespace sim2vr::rl

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/rl/game_facts.hpp"

#include <cctype>
#include <nlohmann/json.hpp>
#include <set>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::rl {
namespace {

using Json = nlohmann::ordered_json;

std::string_view betterName(Better better) {
  switch (better) {
    case Better::kHigher:
      return "higher";
    case Better::kLower:
      return "lower";
    case Better::kNone:
      break;
  }
  return "none";
}

// my_game -> MyGame.
std::string inCapitals(std::string_view name) {
  std::string id;
  bool first = true;
  for (const char letter : name) {
    const bool usable = std::isalnum(static_cast<unsigned char>(letter)) != 0;
    if (usable) {
      id += first ? static_cast<char>(std::toupper(static_cast<unsigned char>(letter))) : letter;
    }
    first = !usable;
  }
  return id;
}

Json objectOf(const std::string& field, const std::string& text) {
  Json object = Json::parse(text, nullptr, false);
  if (!object.is_object()) throw InvalidArgument(field, "'" + text + "'", "a JSON object");
  return object;
}

Json textOrNull(const std::string& text) { return text.empty() ? Json(nullptr) : Json(text); }

Json measureJson(const Measure& measure) {
  if (measure.name.empty() || measure.label.empty() || measure.log_key.empty()) {
    throw InvalidArgument("measures", "'" + measure.name + "'", "a name, a label and a log_key");
  }
  Json grid = nullptr;
  if (measure.grid) grid = {measure.grid->rows, measure.grid->columns};
  return {{"name", measure.name},
          {"label", measure.label},
          {"unit", measure.unit},
          {"better", betterName(measure.better)},
          {"digits", measure.digits},
          {"log_key", measure.log_key},
          {"rate_with", textOrNull(measure.rate_with)},
          {"grid", grid},
          {"only_if", textOrNull(measure.only_if)},
          {"description", measure.description}};
}

Json conditionJson(const GameCondition& condition) {
  return {{"name", condition.name},
          {"description", condition.description},
          {"options", objectOf("condition '" + condition.name + "'", condition.options_json)},
          {"draws", condition.draws},
          {"evaluated", condition.evaluated}};
}

Json itemJson(const LoggedItem& item) {
  if (item.name.empty() || item.id_field.empty() || item.outcomes.empty()) {
    throw InvalidArgument("items", "'" + item.name + "'", "a name, an id_field and outcomes");
  }
  Json outcomes = Json::array();
  for (const LoggedItem::Outcome& outcome : item.outcomes) {
    outcomes.push_back(
        {{"event", outcome.event}, {"name", outcome.name}, {"success", outcome.success}});
  }
  return {{"name", item.name},
          {"id_field", item.id_field},
          {"begin_event", textOrNull(item.begin_event)},
          {"outcomes", outcomes},
          {"counted_events", item.counted_events},
          {"cell_field", textOrNull(item.cell_field)},
          {"place_field", textOrNull(item.place_field)},
          {"places_event", textOrNull(item.places_event)},
          {"velocity_field", textOrNull(item.velocity_field)}};
}

std::set<std::string> keysOf(const Json& object) {
  std::set<std::string> keys;
  for (const auto& [key, value] : object.items()) keys.insert(key);
  return keys;
}

void checkConditions(const Json& conditions, const std::string& default_condition) {
  std::set<std::string> names;
  for (const Json& condition : conditions) {
    const std::string name = condition["name"];
    if (!names.insert(name).second) {
      throw InvalidArgument("conditions", "'" + name + "' twice", "every name once");
    }
    if (keysOf(condition["options"]) != keysOf(conditions.front()["options"])) {
      throw InvalidArgument("conditions", "'" + name + "', which sets other options",
                            "conditions that all set the same options");
    }
  }
  if (!names.contains(default_condition)) {
    throw InvalidArgument("default_condition", "'" + default_condition + "'",
                          "the name of a condition");
  }
  for (const Json& condition : conditions) {
    for (const std::string drawn : condition["draws"]) {
      if (!names.contains(drawn)) {
        throw InvalidArgument("draws", "'" + drawn + "'", "the name of a condition");
      }
    }
  }
}

void checkScore(const Json& measures, const std::string& score) {
  std::set<std::string> names;
  bool found = score.empty();
  for (const Json& measure : measures) {
    const std::string name = measure["name"];
    if (!names.insert(name).second) {
      throw InvalidArgument("measures", "'" + name + "' twice", "every name once");
    }
    found = found || (name == score && measure["grid"].is_null());
  }
  if (!found) throw InvalidArgument("score", "'" + score + "'", "the name of a measure, no grid");
}

void checkDevices(const std::vector<std::string>& devices) {
  for (const std::string& device : devices) {
    if (device != "controller_right" && device != "controller_left") {
      throw InvalidArgument("devices", "'" + device + "'",
                            "'controller_right' or 'controller_left'");
    }
  }
}

}  // namespace

std::string factsJson(std::string_view name, std::string_view description, GameFacts facts) {
  if (facts.conditions.empty()) {
    facts.default_condition = "default";
    facts.conditions = {{.name = "default", .description = "Every option at its default"}};
  }
  bool any = false;
  for (const GameCondition& condition : facts.conditions) any = any || condition.evaluated;
  Json measures = Json::array();
  for (const Measure& measure : facts.measures) measures.push_back(measureJson(measure));
  Json conditions = Json::array();
  for (GameCondition& condition : facts.conditions) {
    condition.evaluated =
        condition.evaluated || (!any && condition.name == facts.default_condition);
    conditions.push_back(conditionJson(condition));
  }
  Json terms = Json::array();
  for (const RewardTerm& term : facts.reward_terms) {
    terms.push_back({{"log_key", term.log_key}, {"label", term.label}});
  }
  Json items = Json::array();
  for (const LoggedItem& item : facts.items) items.push_back(itemJson(item));
  checkDevices(facts.devices);
  checkScore(measures, facts.score);
  checkConditions(conditions, facts.default_condition);
  Json all{{"name", name},
           {"description", description},
           {"id", facts.id.empty() ? inCapitals(name) : facts.id},
           {"round_seconds", facts.round_seconds},
           {"devices", facts.devices},
           {"hand_option", textOrNull(facts.hand_option)},
           {"level_option", textOrNull(facts.level_option)},
           {"measures", measures},
           {"score", textOrNull(facts.score)},
           {"reward_terms", terms},
           {"reward_rest", facts.reward_rest},
           {"items", items},
           {"conditions", conditions},
           {"default_condition", facts.default_condition},
           {"evaluation_options", objectOf("evaluation_options", facts.evaluation_options_json)}};
  // Left out by games without, whose facts stay as they were.
  if (!facts.inputs.empty()) all["inputs"] = facts.inputs;
  return all.dump();
}

}  // namespace sim2vr::rl

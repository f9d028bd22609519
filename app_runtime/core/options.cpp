#include "sim2vr/core/options.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "sim2vr/core/errors.hpp"

namespace sim2vr {
namespace {

using Json = nlohmann::json;

std::string optionField(const std::string& name) { return "option '" + name + "'"; }

double numberInRange(const std::string& field, const Json& value, double minimum, double maximum) {
  const bool in_range =
      value.is_number() && value.get<double>() >= minimum && value.get<double>() <= maximum;
  if (!in_range) {
    throw InvalidArgument(field, value.dump(),
                          "a number from " + Json(minimum).dump() + " to " + Json(maximum).dump());
  }
  return value.get<double>();
}

std::string description(const std::string& name, const char* type, Json fallback,
                        const Json& more = Json::object()) {
  Json made = {{"name", name}, {"type", type}, {"default", std::move(fallback)}};
  made.update(more);
  return made.dump();
}

Json rangeOf(double minimum, double maximum) {
  return {{"minimum", minimum}, {"maximum", maximum}};
}

}  // namespace

Options Options::fromJson(std::string_view json) {
  const Json parsed = Json::parse(json, nullptr, /*allow_exceptions=*/false);
  if (!parsed.is_object()) {
    throw InvalidArgument("options", "'" + std::string(json.substr(0, 80)) + "'", "a JSON object");
  }
  Options options;
  options.json_text_ = parsed.dump();
  return options;
}

bool Options::has(const std::string& name) const { return Json::parse(json_text_).contains(name); }

std::string Options::getString(const std::string& name, std::string_view fallback) {
  read_[name] = description(name, "text", fallback);
  const Json values = Json::parse(json_text_);
  const auto found = values.find(name);
  if (found == values.end()) return std::string(fallback);
  if (!found->is_string()) throw InvalidArgument(optionField(name), found->dump(), "a string");
  return found->get<std::string>();
}

std::string Options::getChoice(const std::string& name, std::string_view fallback,
                               std::span<const std::string> choices) {
  const std::string value = getString(name, fallback);
  const std::vector<std::string> known(choices.begin(), choices.end());
  read_[name] = description(name, "choice", fallback, {{"choices", known}});
  if (std::find(choices.begin(), choices.end(), value) == choices.end()) {
    throw InvalidArgument(optionField(name), "'" + value + "'", oneOf(choices, value));
  }
  return value;
}

bool Options::getBool(const std::string& name, bool fallback) {
  read_[name] = description(name, "bool", fallback);
  const Json values = Json::parse(json_text_);
  const auto found = values.find(name);
  if (found == values.end()) return fallback;
  if (!found->is_boolean())
    throw InvalidArgument(optionField(name), found->dump(), "true or false");
  return found->get<bool>();
}

double Options::getNumber(const std::string& name, double fallback, double minimum,
                          double maximum) {
  read_[name] = description(name, "number", fallback, rangeOf(minimum, maximum));
  const Json values = Json::parse(json_text_);
  const auto found = values.find(name);
  if (found == values.end()) return fallback;
  return numberInRange(optionField(name), *found, minimum, maximum);
}

std::vector<double> Options::getNumbers(const std::string& name, double minimum, double maximum) {
  read_[name] = description(name, "numbers", Json::array(), rangeOf(minimum, maximum));
  const Json values = Json::parse(json_text_);
  const auto found = values.find(name);
  if (found == values.end()) return {};
  if (!found->is_array()) {
    throw InvalidArgument(optionField(name), found->dump(), "a list of numbers");
  }
  std::vector<double> numbers;
  for (const Json& value : *found) {
    const std::string field = optionField(name) + "[" + std::to_string(numbers.size()) + "]";
    numbers.push_back(numberInRange(field, value, minimum, maximum));
  }
  return numbers;
}

std::string Options::describe() const {
  Json options = Json::array();
  for (const auto& option : read_) options.push_back(Json::parse(option.second));
  return options.dump();
}

void Options::expectAllRead() const {
  const Json values = Json::parse(json_text_);
  for (const auto& item : values.items()) {
    if (read_.contains(item.key())) continue;
    std::vector<std::string> known;
    for (const auto& option : read_) known.push_back(option.first);
    throw InvalidArgument("options", "unknown option '" + item.key() + "'",
                          oneOf(known, item.key()));
  }
}

}  // namespace sim2vr

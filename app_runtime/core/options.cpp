#include "sim2vr/core/options.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

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
  read_.insert(name);
  const Json values = Json::parse(json_text_);
  const auto found = values.find(name);
  if (found == values.end()) return std::string(fallback);
  if (!found->is_string()) throw InvalidArgument(optionField(name), found->dump(), "a string");
  return found->get<std::string>();
}

std::string Options::getChoice(const std::string& name, std::string_view fallback,
                               std::span<const std::string> choices) {
  const std::string value = getString(name, fallback);
  if (std::find(choices.begin(), choices.end(), value) == choices.end()) {
    throw InvalidArgument(optionField(name), "'" + value + "'", oneOf(choices, value));
  }
  return value;
}

bool Options::getBool(const std::string& name, bool fallback) {
  read_.insert(name);
  const Json values = Json::parse(json_text_);
  const auto found = values.find(name);
  if (found == values.end()) return fallback;
  if (!found->is_boolean())
    throw InvalidArgument(optionField(name), found->dump(), "true or false");
  return found->get<bool>();
}

double Options::getNumber(const std::string& name, double fallback, double minimum,
                          double maximum) {
  read_.insert(name);
  const Json values = Json::parse(json_text_);
  const auto found = values.find(name);
  if (found == values.end()) return fallback;
  return numberInRange(optionField(name), *found, minimum, maximum);
}

std::vector<double> Options::getNumbers(const std::string& name, double minimum, double maximum) {
  read_.insert(name);
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

void Options::expectAllRead() const {
  const Json values = Json::parse(json_text_);
  for (const auto& item : values.items()) {
    if (read_.contains(item.key())) continue;
    const std::vector<std::string> known(read_.begin(), read_.end());
    throw InvalidArgument("options", "unknown option '" + item.key() + "'",
                          oneOf(known, item.key()));
  }
}

}  // namespace sim2vr

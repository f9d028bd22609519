// SPDX-License-Identifier: Apache-2.0
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

Json rangeOf(double minimum, double maximum) {
  return {{"minimum", minimum}, {"maximum", maximum}};
}

}  // namespace

nlohmann::json jsonObject(std::string_view field, std::string_view text) {
  Json parsed = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (parsed.is_object()) return parsed;
  throw InvalidArgument(std::string(field), "'" + std::string(text.substr(0, 80)) + "'",
                        "a JSON object");
}

std::string mergedOptions(std::string_view current, std::string_view changes) {
  Json merged = jsonObject("options", current);
  merged.update(jsonObject("options", changes));
  return merged.dump();
}

struct Options::Content {
  Json values = Json::object();
  /// Name -> what describe() says of it.
  Json read = Json::object();
};

Options::Options(Json values) : content_(std::make_unique<Content>()) {
  content_->values = std::move(values);
}
Options::Options() : Options(Json::object()) {}
Options::~Options() = default;

Options Options::fromJson(std::string_view json) { return Options(jsonObject("options", json)); }

const Json* Options::find(const std::string& name, const char* type, const Json& fallback,
                          const Json& more) {
  Json& described = content_->read[name];
  described = {{"name", name}, {"type", type}, {"default", fallback}};
  described.update(more);
  const auto found = content_->values.find(name);
  return found == content_->values.end() ? nullptr : &*found;
}

bool Options::has(const std::string& name) const { return content_->values.contains(name); }

bool Options::wasRead(const std::string& name) const { return content_->read.contains(name); }

std::string Options::getString(const std::string& name, std::string_view fallback) {
  const Json* found = find(name, "text", fallback, Json::object());
  if (found == nullptr) return std::string(fallback);
  if (!found->is_string()) throw InvalidArgument(optionField(name), found->dump(), "a string");
  return found->get<std::string>();
}

std::string Options::getChoice(const std::string& name, std::string_view fallback,
                               std::span<const std::string> choices) {
  const std::string value = getString(name, fallback);
  find(name, "choice", fallback,
       {{"choices", std::vector<std::string>(choices.begin(), choices.end())}});
  if (std::ranges::find(choices, value) == choices.end()) {
    throw InvalidArgument(optionField(name), "'" + value + "'", oneOf(choices, value));
  }
  return value;
}

bool Options::getBool(const std::string& name, bool fallback) {
  const Json* found = find(name, "bool", fallback, Json::object());
  if (found == nullptr) return fallback;
  if (!found->is_boolean())
    throw InvalidArgument(optionField(name), found->dump(), "true or false");
  return found->get<bool>();
}

double Options::getNumber(const std::string& name, double fallback, double minimum,
                          double maximum) {
  const Json* found = find(name, "number", fallback, rangeOf(minimum, maximum));
  return found == nullptr ? fallback : numberInRange(optionField(name), *found, minimum, maximum);
}

std::vector<double> Options::getNumbers(const std::string& name, double minimum, double maximum) {
  const Json* found = find(name, "numbers", Json::array(), rangeOf(minimum, maximum));
  if (found == nullptr) return {};
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
  for (const Json& option : content_->read) options.push_back(option);
  return options.dump();
}

void Options::expectAllRead() const {
  for (const auto& item : content_->values.items()) {
    if (wasRead(item.key())) continue;
    std::vector<std::string> known;
    for (const auto& option : content_->read.items()) known.push_back(option.key());
    throw InvalidArgument("options", "unknown option '" + item.key() + "'",
                          oneOf(known, item.key()));
  }
}

}  // namespace sim2vr

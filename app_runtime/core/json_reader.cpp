// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/json_reader.hpp"

#include <algorithm>
#include <cmath>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/text.hpp"

namespace sim2vr {
namespace {

using Json = nlohmann::json;

constexpr int kMaximumDepth = 32;
constexpr std::size_t kShownCharacters = 60;

[[noreturn]] void refuse(const std::string& field, const std::string& got,
                         const std::string& expected) {
  throw InvalidArgument(field, got, expected);
}

std::string describe(const Json& value) {
  if (value.is_object() || value.is_array()) return std::string("an ") + value.type_name();
  const std::string text = value.dump(-1, ' ', true, Json::error_handler_t::replace);
  return text.size() <= kShownCharacters ? text : text.substr(0, kShownCharacters) + "...";
}

/// Programs of Windows write UTF-16 and Latin-1 as well, which JSON is not.
void expectUtf8(std::string_view text, const std::string& what) {
  if (text.starts_with("\xFF\xFE") || text.starts_with("\xFE\xFF")) {
    refuse(what, "text in UTF-16", "a JSON object in UTF-8");
  }
  const std::string valid = validUtf8(text);
  if (valid == text) return;
  const auto first = std::mismatch(text.begin(), text.end(), valid.begin(), valid.end()).first;
  const auto at = static_cast<std::size_t>(first - text.begin());
  refuse(what, "text that is not UTF-8 at byte " + std::to_string(at), "a JSON object in UTF-8");
}

/// Before anything is built in memory.
void checkShape(std::string_view text, const std::string& what, std::size_t maximum_values) {
  int depth = 0;
  std::size_t values = 0;
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (quoted) {
      if (c == '\\') ++i;
      if (c == '"') quoted = false;
      continue;
    }
    if (c == '"') quoted = true;
    if (c == '{' || c == '[') ++depth;
    if (c == '}' || c == ']') --depth;
    if (c == ',') ++values;
    if (depth > kMaximumDepth) {
      refuse(what, "JSON nested deeper", std::to_string(kMaximumDepth) + " levels at most");
    }
    if (values > maximum_values) {
      refuse(what, "JSON with more values", std::to_string(maximum_values) + " at most");
    }
  }
}

}  // namespace

Json parseJson(std::string_view text, const std::string& what, std::size_t maximum_values) {
  checkShape(text, what, maximum_values);
  Json parsed;
  try {
    parsed = Json::parse(text);
  } catch (const Json::exception& error) {
    expectUtf8(text, what);
    refuse(what, "no JSON (NaN and Infinity are none either): " + std::string(error.what()),
           "a JSON object");
  }
  if (!parsed.is_object()) refuse(what, describe(parsed), "a JSON object");
  return parsed;
}

JsonFields::JsonFields(const Json& object, std::string path)
    : object_(&object), path_(std::move(path)) {
  if (!object.is_object()) refuse(path_, describe(object), "an object");
}

const Json* JsonFields::find(const char* name) const {
  const auto found = object_->find(name);
  return found == object_->end() || found->is_null() ? nullptr : &*found;
}

double JsonFields::number(const char* name, double fallback) const {
  const Json* value = find(name);
  if (value == nullptr) return fallback;
  if (!value->is_number()) refuse(path(name), describe(*value), "a number");
  return value->get<double>();
}

double JsonFields::number(const char* name, double fallback, double minimum, double maximum) const {
  const double value = number(name, fallback);
  if (value >= minimum && value <= maximum) return value;
  refuse(path(name), Json(value).dump(),
         "a number from " + Json(minimum).dump() + " to " + Json(maximum).dump());
}

std::int64_t JsonFields::integer(const char* name, std::int64_t fallback, std::int64_t minimum,
                                 std::int64_t maximum) const {
  const Json* value = find(name);
  if (value == nullptr) return fallback;
  const auto outOfRange = [&] {
    refuse(path(name), describe(*value),
           "a whole number from " + std::to_string(minimum) + " to " + std::to_string(maximum));
  };
  if (!value->is_number()) outOfRange();
  if (value->is_number_unsigned() &&
      value->get<std::uint64_t>() > static_cast<std::uint64_t>(maximum)) {
    outOfRange();
  }
  if (value->is_number_float()) {
    // 20.0 is a whole number; beyond 2^53 not every one can be represented.
    const auto real = value->get<double>();
    if (!(std::abs(real) <= 9007199254740992.0) || std::trunc(real) != real) outOfRange();
  }
  const auto whole = value->get<std::int64_t>();
  if (whole < minimum || whole > maximum) outOfRange();
  return whole;
}

bool JsonFields::flag(const char* name, bool fallback) const {
  const Json* value = find(name);
  if (value == nullptr) return fallback;
  if (!value->is_boolean()) refuse(path(name), describe(*value), "true or false");
  return value->get<bool>();
}

std::string JsonFields::text(const char* name, const std::string& fallback) const {
  const Json* value = find(name);
  if (value == nullptr) return fallback;
  if (!value->is_string()) refuse(path(name), describe(*value), "a string");
  return value->get<std::string>();
}

std::optional<JsonFields> JsonFields::object(const char* name) const {
  const Json* value = find(name);
  if (value == nullptr) return std::nullopt;
  return JsonFields(*value, path(name));
}

std::string JsonFields::objectText(const char* name) const {
  const Json* value = find(name);
  if (value == nullptr) return "{}";
  return JsonFields(*value, path(name)).object_->dump();
}

std::vector<std::string> JsonFields::texts(const char* name) const {
  std::vector<std::string> items;
  const Json* value = find(name);
  if (value == nullptr) return items;
  if (!value->is_array()) refuse(path(name), describe(*value), "an array");
  for (const Json& item : *value) {
    if (!item.is_string()) {
      refuse(path(name) + "[" + std::to_string(items.size()) + "]", describe(item), "a string");
    }
    items.push_back(item.get<std::string>());
  }
  return items;
}

std::vector<JsonFields> JsonFields::objects(const char* name) const {
  std::vector<JsonFields> items;
  const Json* value = find(name);
  if (value == nullptr) return items;
  if (!value->is_array()) refuse(path(name), describe(*value), "an array");
  for (const Json& item : *value) {
    items.emplace_back(item, path(name) + "[" + std::to_string(items.size()) + "]");
  }
  return items;
}

void JsonFields::expect(const char* name, const std::string& expected) const {
  if (!has(name)) refuse(path(name), "none", expected);
}

void JsonFields::expectOnly(const std::vector<std::string>& known) const {
  for (const auto& item : object_->items()) {
    if (std::find(known.begin(), known.end(), item.key()) != known.end()) continue;
    refuse(path_, "the unknown field '" + item.key() + "'", oneOf(known, item.key()));
  }
}

std::vector<std::string> JsonFields::names() const {
  std::vector<std::string> found;
  for (const auto& item : object_->items()) found.push_back(item.key());
  return found;
}

}  // namespace sim2vr

// SPDX-License-Identifier: Apache-2.0
// Strict reading of JSON that a stranger wrote: every surprise is an InvalidArgument whose field is
// the path to it, such as "state.frames[2].time".
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace sim2vr {

/// Values in one JSON text, unless the reader says otherwise.
inline constexpr std::size_t kMaximumJsonValues = 1'000'000;

/// Parses an object. `what` names it in errors. Nesting is limited to 32 levels and the number of
/// values to `maximum_values`, so that no text can exhaust stack or memory.
nlohmann::json parseJson(std::string_view text, const std::string& what,
                         std::size_t maximum_values = kMaximumJsonValues);

/// The fields of an object. One that is missing or null has its fallback.
class JsonFields {
 public:
  JsonFields(const nlohmann::json& object, std::string path);

  bool has(const char* name) const { return find(name) != nullptr; }
  double number(const char* name, double fallback) const;
  double number(const char* name, double fallback, double minimum, double maximum) const;
  std::int64_t integer(const char* name, std::int64_t fallback, std::int64_t minimum,
                       std::int64_t maximum) const;
  bool flag(const char* name, bool fallback = false) const;
  std::string text(const char* name, const std::string& fallback) const;
  std::optional<JsonFields> object(const char* name) const;
  /// An object as JSON text; "{}" when it is missing.
  std::string objectText(const char* name) const;
  /// The strings in an array; none when it is missing.
  std::vector<std::string> texts(const char* name) const;
  /// The objects in an array; none when it is missing.
  std::vector<JsonFields> objects(const char* name) const;
  /// Throws for a field that is not there (or null); `expected` says what it should hold.
  void expect(const char* name, const std::string& expected) const;
  /// Throws for a field that is not among `known`.
  void expectOnly(const std::vector<std::string>& known) const;
  /// Names of all fields.
  std::vector<std::string> names() const;

  /// How errors name a field.
  std::string path(const std::string& name) const { return path_ + "." + name; }

 private:
  const nlohmann::json* find(const char* name) const;

  const nlohmann::json* object_;
  std::string path_;
};

}  // namespace sim2vr

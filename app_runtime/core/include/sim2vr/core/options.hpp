// SPDX-License-Identifier: Apache-2.0
// A game's options as named values with strict reading: a wrong type, a value outside its choices
// or a name that is never read is an error that says what was expected.
#pragma once

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace sim2vr {

/// The object that a text is. Throws InvalidArgument naming the field for anything else.
nlohmann::json jsonObject(std::string_view field, std::string_view text);

/// One object's options with another's added, which win. Throws as jsonObject ("options").
std::string mergedOptions(std::string_view current, std::string_view changes);

class Options {
 public:
  Options();
  ~Options();
  /// Parses a JSON object. Throws InvalidArgument ("options") for anything else.
  static Options fromJson(std::string_view json);

  // Each reads one option and remembers that the name is known. Throws InvalidArgument naming the
  // option for another type or a value out of range.
  std::string getString(const std::string& name, std::string_view fallback);
  /// As getString, but the value must be one of `choices`.
  std::string getChoice(const std::string& name, std::string_view fallback,
                        std::span<const std::string> choices);
  bool getBool(const std::string& name, bool fallback);
  double getNumber(const std::string& name, double fallback, double minimum, double maximum);
  /// A list of numbers; empty when the option is not given.
  std::vector<double> getNumbers(const std::string& name, double minimum, double maximum);
  bool has(const std::string& name) const;
  /// Whether the option was read: after Game::configure, whether the game knows it.
  bool wasRead(const std::string& name) const;

  /// A JSON array of the options read so far, by name: name, type (text, choice, bool, number or
  /// numbers) and default; of choices `choices`, of numbers `minimum` and `maximum`.
  std::string describe() const;
  /// Throws InvalidArgument for the first option that was never read, with the nearest known name.
  void expectAllRead() const;

 private:
  struct Content;

  explicit Options(nlohmann::json values);
  /// The option's value, or null; notes what describe() says of it.
  const nlohmann::json* find(const std::string& name, const char* type,
                             const nlohmann::json& fallback, const nlohmann::json& more);

  std::unique_ptr<Content> content_;
};

}  // namespace sim2vr

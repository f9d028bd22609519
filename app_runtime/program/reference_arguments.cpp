// SPDX-License-Identifier: Apache-2.0
// The reference's single-dash arguments.
#include <array>
#include <cctype>
#include <charconv>
#include <string_view>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/text.hpp"
#include "sim2vr/program/arguments.hpp"

namespace sim2vr::program {
namespace {

struct Known {
  std::string_view name;
  std::string_view option;
  bool has_value;
};

constexpr std::array<Known, 17> kKnown{{
    {"-simulated", "--simulated", false},
    {"-port", "--port", true},
    {"-logFile", "--log-file", true},
    {"-outputFolder", "--output-folder", true},
    {"-record", "--record", false},
    {"-resolution", "--resolution", true},
    {"-logging", "--logging", false},
    {"-fixedSeed", "--fixed-seed", true},
    {"-condition", "--condition", true},
    {"-adaptive", "--adaptive", false},
    {"-sparse", "--sparse", false},
    {"-replay", "--replay", false},
    {"-playbackRate", "--playback-rate", true},
    {"-stateLogFilepath", "--state-log", true},
    {"-eventLogFilepath", "--event-log", true},
    {"-game", "--game", true},
    {"-h", "--help", false},
}};

const Known* find(std::string_view name) {
  for (const Known& known : kKnown) {
    if (known.name == name) return &known;
  }
  return nullptr;
}

std::string didYouMeanArgument(const std::string& name) {
  std::vector<std::string> names;
  for (const Known& known : kKnown) names.emplace_back(known.name);
  return didYouMean(name, names);
}

/// "-port" but not "--port", and not the value "-5".
bool isReferenceArgument(const std::string& word) {
  return word.size() > 1 && word[0] == '-' && std::isalpha(static_cast<unsigned char>(word[1]));
}

bool isOption(const std::string& word) {
  return word.starts_with("--") || isReferenceArgument(word);
}

/// The reference's app plays with seed 0 where it cannot read the seed; one that ended instead
/// would let its client wait for ever.
std::string readableSeed(const std::string& value, std::vector<std::string>& warnings) {
  std::uint32_t seed = 0;
  const char* end = value.data() + value.size();
  const auto [stop, problem] = std::from_chars(value.data(), end, seed);
  if (problem == std::errc() && stop == end) return value;
  warnings.push_back("-fixedSeed: got '" + printable(value) +
                     "', expected a whole number from 0 to 4294967295; it counts as 0, as in the "
                     "reference: seeds are drawn");
  return "0";
}

}  // namespace

std::vector<std::string> translateReferenceArguments(const std::vector<std::string>& words,
                                                     std::vector<std::string>& warnings) {
  std::vector<std::string> translated;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (!isReferenceArgument(words[i])) {
      translated.push_back(words[i]);
      continue;
    }
    const std::size_t separator = words[i].find_first_of("= ");
    const std::string name = words[i].substr(0, separator);
    std::optional<std::string> value;
    if (separator != std::string::npos) value = words[i].substr(separator + 1);
    const bool value_follows = !value && i + 1 < words.size() && !isOption(words[i + 1]);
    const Known* known = find(name);
    if (known == nullptr) {
      if (value_follows) ++i;
      warnings.push_back("the argument " + name + " is not known and has no effect" +
                         didYouMeanArgument(name));
    } else if (!known->has_value) {
      if (value) throw InvalidArgument(name, "the value '" + *value + "'", "none");
      translated.emplace_back(known->option);
    } else {
      if (value_follows) value = words[++i];
      if (name == "-fixedSeed") value = readableSeed(value.value_or(""), warnings);
      if (!value || value->empty()) throw InvalidArgument(name, "no value", "one after it");
      translated.push_back(std::string(known->option) + "=" + *value);
    }
  }
  return translated;
}

}  // namespace sim2vr::program

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/errors.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <vector>

namespace sim2vr {
namespace {

/// More names than that bury the one that was meant.
constexpr std::size_t kReadableList = 12;

/// Control characters as JSON spells them: they end texts and lines, or colour the terminal.
std::string oneLine(std::string_view text) {
  std::string line;
  for (const char c : text) {
    const auto code = static_cast<unsigned char>(c);
    if (c == '\n') {
      line += "\\n";
    } else if (code < 0x20 || code == 0x7f) {
      line += fmt::format("\\u{:04x}", static_cast<unsigned>(code));
    } else {
      line += c;
    }
  }
  return line;
}

std::string composeMessage(std::string_view field, std::string_view got,
                           std::string_view expected) {
  std::string message(field);
  message.append(": got ").append(got).append(", expected ").append(expected);
  return oneLine(message);
}

std::size_t editDistance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t substituted = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, substituted});
    }
  }
  return row[b.size()];
}

}  // namespace

InvalidArgument::InvalidArgument(std::string_view field, std::string_view got,
                                 std::string_view expected)
    : std::invalid_argument(composeMessage(field, got, expected)),
      field_(field),
      got_(got),
      expected_(expected) {}

std::string didYouMean(std::string_view got, std::span<const std::string> candidates) {
  const std::string* nearest = nullptr;
  std::size_t nearest_distance = std::max<std::size_t>(2, got.size() / 2) + 1;
  for (const std::string& candidate : candidates) {
    const std::size_t distance = editDistance(got, candidate);
    if (distance < nearest_distance) {
      nearest_distance = distance;
      nearest = &candidate;
    }
  }
  return nearest == nullptr ? "" : "; did you mean '" + *nearest + "'?";
}

std::string oneOf(std::span<const std::string> choices, std::string_view got) {
  const std::string hint = didYouMean(got, choices);
  if (choices.size() > kReadableList && !hint.empty()) {
    return "one of " + std::to_string(choices.size()) + " names" + hint;
  }
  return "one of " + listChoices(choices) + hint;
}

std::string listChoices(std::span<const std::string> choices) {
  // A long list hides what was wrong.
  constexpr std::size_t kMost = 12;
  constexpr std::size_t kSome = 4;
  const bool all = choices.size() <= kMost;
  const std::size_t listed = all ? choices.size() : kSome;
  std::string list;
  for (std::size_t i = 0; i < listed; ++i) {
    if (i > 0) list += all && i + 1 == listed ? " or " : ", ";
    list += "'" + choices[i] + "'";
  }
  if (!all) list += " and " + std::to_string(choices.size() - listed) + " more";
  return list;
}

}  // namespace sim2vr

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/rl/state_log.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/text.hpp"

namespace sim2vr::rl {
namespace {

constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
constexpr std::string_view kTitle = "'condition C, random seed N'";
constexpr double kLatest_s = 1e9;
constexpr StateLog::PoseNumbers kOrigin{0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};

class Lines {
 public:
  explicit Lines(std::string_view text) : text_(text) {
    if (text_.starts_with(kByteOrderMark)) text_.remove_prefix(kByteOrderMark.size());
  }

  /// Lines end with LF, CR LF or CR.
  bool next(std::string_view& line) {
    if (text_.empty()) return false;
    const std::size_t end = std::min(text_.find_first_of("\r\n"), text_.size());
    line = text_.substr(0, end);
    text_.remove_prefix(end);
    text_.remove_prefix(text_.starts_with("\r\n") ? 2 : std::min<std::size_t>(text_.size(), 1));
    ++number_;
    return true;
  }

  /// Whether nothing but separators and ends of lines follows.
  bool atEnd() const { return text_.find_first_not_of(", \t\r\n") == std::string_view::npos; }

  [[noreturn]] void refuse(std::string_view got, std::string_view expected) const {
    throw InvalidArgument("states.csv line " + std::to_string(number_),
                          "'" + printable(got, 60) + "'", expected);
  }

 private:
  std::string_view text_;
  std::size_t number_ = 0;
};

/// Spreadsheets save with tabs instead of ", ", and with commas behind short lines.
std::vector<std::string_view> split(std::string_view line) {
  constexpr std::string_view separators = ", \t";
  std::vector<std::string_view> fields;
  while (true) {
    line.remove_prefix(std::min(line.find_first_not_of(separators), line.size()));
    if (line.empty()) return fields;
    const std::size_t end = std::min(line.find_first_of(separators), line.size());
    fields.push_back(line.substr(0, end));
    line.remove_prefix(end);
  }
}

bool isDigit(char c) { return c >= '0' && c <= '9'; }

/// A whole number of any length, modulo 2^32: the original takes any 32-bit seed, signed or not.
bool parseSeed(std::string_view text, std::uint32_t& seed) {
  const bool negative = text.starts_with('-');
  if (negative) text.remove_prefix(1);
  if (text.empty() || !std::all_of(text.begin(), text.end(), isDigit)) return false;
  seed = 0;
  for (const char digit : text) seed = seed * 10U + static_cast<std::uint32_t>(digit - '0');
  if (negative) seed = 0U - seed;
  return true;
}

void readTitle(const Lines& lines, std::string_view line, StateLog& log) {
  const std::vector<std::string_view> words = split(line);
  const std::size_t count = words.size();
  const bool fits = count >= 5 && words[0] == "condition" && words[count - 3] == "random" &&
                    words[count - 2] == "seed" && parseSeed(words[count - 1], log.seed);
  if (!fits) lines.refuse(line, kTitle);
  log.condition = words[1];
  // The names of generated levels hold their seeds.
  for (std::size_t i = 2; i + 3 < count; ++i) log.condition.append(" ").append(words[i]);
}

/// First columns of the poses.
struct Columns {
  std::size_t count = 0;
  std::size_t left = 0;
  std::size_t right = 0;
  std::size_t head = 0;
};

Columns readHeader(const Lines& lines, std::string_view line) {
  const std::vector<std::string_view> names = split(line);
  const auto column = [&](std::string_view name) {
    const auto found = std::find(names.begin(), names.end(), name);
    const auto index = static_cast<std::size_t>(found - names.begin());
    if (index + 7 > names.size()) {
      lines.refuse(line, "a column " + std::string(name) + " and six more for the pose");
    }
    return index;
  };
  return {names.size(), column("left_pos_x"), column("right_pos_x"), column("head_pos_x")};
}

/// The finite numbers of a row; none when a field is none.
std::vector<double> numbersOf(const std::vector<std::string_view>& fields) {
  std::vector<double> numbers;
  numbers.reserve(fields.size());
  for (const std::string_view field : fields) {
    const char* end = field.data() + field.size();
    double value = 0.0;
    const auto [stop, problem] = std::from_chars(field.data(), end, value);
    if (problem != std::errc() || stop != end || !std::isfinite(value)) return {};
    numbers.push_back(value);
  }
  return numbers;
}

StateLog::PoseNumbers pose(const std::vector<double>& numbers, std::size_t column) {
  StateLog::PoseNumbers found{};
  std::copy_n(numbers.begin() + static_cast<std::ptrdiff_t>(column), found.size(), found.begin());
  return found;
}

StateLog::Row rowOf(const std::vector<double>& numbers, const Columns& columns) {
  StateLog::Row row;
  row.time_s = numbers[0];
  row.left = pose(numbers, columns.left);
  row.right = pose(numbers, columns.right);
  row.head = pose(numbers, columns.head);
  row.left_tracked = row.left != kOrigin;
  return row;
}

}  // namespace

StateLog parseStateLog(std::string_view text) {
  Lines lines(text);
  StateLog log;
  std::string_view line;
  if (!lines.next(line)) lines.refuse("", kTitle);
  readTitle(lines, line, log);
  if (!lines.next(line)) lines.refuse("", "the names of the columns");
  const Columns columns = readHeader(lines, line);
  double earliest_s = 0.0;
  while (lines.next(line)) {
    const std::vector<std::string_view> fields = split(line);
    if (fields.empty()) continue;
    const std::vector<double> numbers = numbersOf(fields);
    if (numbers.size() != columns.count) {
      // A round that was cut off ends in the middle of a line.
      if (lines.atEnd() && !log.rows.empty()) break;
      lines.refuse(line, std::to_string(columns.count) + " numbers, as the header has columns");
    }
    if (!(numbers[0] >= earliest_s && numbers[0] <= kLatest_s)) {
      lines.refuse(fields[0],
                   log.rows.empty() ? "0 to 1e9 s" : "a time from the row above to 1e9 s");
    }
    earliest_s = numbers[0];
    log.rows.push_back(rowOf(numbers, columns));
  }
  if (log.rows.empty()) lines.refuse("", "at least one row");
  return log;
}

StateLog readStateLog(const std::filesystem::path& path) {
  const std::string text = readTextFile("state log", path, "a readable states.csv");
  try {
    return parseStateLog(text);
  } catch (const InvalidArgument& error) {
    throw InvalidArgument("state log '" + printable(path.string()) + "', " + error.field(),
                          error.got(), error.expected());
  }
}

}  // namespace sim2vr::rl

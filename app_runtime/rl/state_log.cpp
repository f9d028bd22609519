#include "sim2vr/rl/state_log.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::rl {
namespace {

constexpr std::string_view kConditionPrefix = "condition ";
constexpr std::string_view kSeedPrefix = "random seed ";
constexpr double kLatest_s = 1e9;
constexpr StateLog::PoseNumbers kOrigin{0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};

class Lines {
 public:
  explicit Lines(std::string_view text) : text_(text) {}

  bool next(std::string_view& line) {
    if (text_.empty()) return false;
    const std::size_t end = text_.find('\n');
    line = text_.substr(0, end);
    if (line.ends_with('\r')) line.remove_suffix(1);
    text_.remove_prefix(end == std::string_view::npos ? text_.size() : end + 1);
    ++number_;
    return true;
  }

  [[noreturn]] void refuse(std::string_view got, std::string_view expected) const {
    throw InvalidArgument("states.csv line " + std::to_string(number_),
                          "'" + std::string(got.substr(0, 60)) + "'", expected);
  }

 private:
  std::string_view text_;
  std::size_t number_ = 0;
};

std::vector<std::string_view> split(std::string_view line) {
  std::vector<std::string_view> fields;
  while (true) {
    const std::size_t comma = line.find(',');
    std::string_view field = line.substr(0, comma);
    while (field.starts_with(' ')) field.remove_prefix(1);
    while (field.ends_with(' ')) field.remove_suffix(1);
    fields.push_back(field);
    if (comma == std::string_view::npos) return fields;
    line.remove_prefix(comma + 1);
  }
}

template <class T>
bool parse(std::string_view text, T& value) {
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  return problem == std::errc() && end == text.data() + text.size();
}

void readTitle(const Lines& lines, std::string_view line, StateLog& log) {
  const std::vector<std::string_view> parts = split(line);
  const bool fits = parts.size() == 2 && parts[0].starts_with(kConditionPrefix) &&
                    parts[1].starts_with(kSeedPrefix) &&
                    parse(parts[1].substr(kSeedPrefix.size()), log.seed);
  if (!fits) lines.refuse(line, "'condition C, random seed N'");
  log.condition = parts[0].substr(kConditionPrefix.size());
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

double number(const Lines& lines, std::string_view field) {
  double value = 0.0;
  if (!parse(field, value) || !std::isfinite(value)) lines.refuse(field, "a number");
  return value;
}

StateLog::PoseNumbers pose(const Lines& lines, const std::vector<std::string_view>& fields,
                           std::size_t column) {
  StateLog::PoseNumbers numbers{};
  for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = number(lines, fields[column + i]);
  return numbers;
}

StateLog::Row readRow(const Lines& lines, std::string_view line, const Columns& columns) {
  const std::vector<std::string_view> fields = split(line);
  if (fields.size() != columns.count) {
    lines.refuse(line, std::to_string(columns.count) + " columns, as in the header");
  }
  StateLog::Row row;
  row.time_s = number(lines, fields[0]);
  if (!(row.time_s >= 0.0 && row.time_s <= kLatest_s)) lines.refuse(fields[0], "0 to 1e9 s");
  row.left = pose(lines, fields, columns.left);
  row.right = pose(lines, fields, columns.right);
  row.head = pose(lines, fields, columns.head);
  row.left_tracked = row.left != kOrigin;
  return row;
}

}  // namespace

StateLog parseStateLog(std::string_view text) {
  Lines lines(text);
  StateLog log;
  std::string_view line;
  if (!lines.next(line)) lines.refuse("", "'condition C, random seed N'");
  readTitle(lines, line, log);
  if (!lines.next(line)) lines.refuse("", "the names of the columns");
  const Columns columns = readHeader(lines, line);
  while (lines.next(line)) {
    if (line.empty()) continue;
    log.rows.push_back(readRow(lines, line, columns));
    const std::size_t count = log.rows.size();
    if (count > 1 && log.rows[count - 1].time_s < log.rows[count - 2].time_s) {
      lines.refuse(line, "a time not before the row above");
    }
  }
  if (log.rows.empty()) lines.refuse("", "at least one row");
  return log;
}

StateLog readStateLog(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file || std::filesystem::is_directory(path)) {
    throw InvalidArgument("state log", "'" + path.string() + "'", "a readable states.csv");
  }
  const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  return parseStateLog(text);
}

}  // namespace sim2vr::rl

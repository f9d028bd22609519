// SPDX-License-Identifier: Apache-2.0
#include "beats/level_timeline.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>

#include "beats/directions.hpp"
#include "beats/level_facts.hpp"

namespace sim2vr::games::beats {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kColumns = 4;
constexpr int kRows = 3;
/// More lines make a grid grey.
constexpr std::size_t kMostBeats = 20'000;
constexpr const char* kLeftColor = "#f81818";
constexpr const char* kRightColor = "#18b8d8";
constexpr const char* kMineColor = "#404040";
constexpr const char* kWallColor = "#e08000";

double lane(double column, double row) { return row * kColumns + column; }

Json boxItem(const Box& box, bool problem) {
  const bool left = box.hand == Hand::kLeft;
  const Eigen::Vector2d cut = cutVector(box);
  Json item{{"time_s", box.time_s},
            {"lane", lane(box.column, box.row)},
            {"shape", box.link ? "dot" : "box"},
            {"color", left ? kLeftColor : kRightColor},
            {"kind", std::string(left ? "left" : "right") + (box.link ? " link" : " box")}};
  if (!cut.isZero()) {
    item["arrow_deg"] = std::atan2(cut.y(), cut.x()) * 180.0 / std::numbers::pi;
  }
  if (problem) item["marked"] = true;
  return item;
}

/// A wall is a bar in each row that it covers, as far as it lies in the grid.
void addWall(const Wall& wall, Json& items) {
  const double left = std::max(wall.column, 0.0);
  const double right = std::min(wall.column + wall.width, static_cast<double>(kColumns));
  for (int row = 0; row < kRows; ++row) {
    const bool covered = wall.row < row + 1 && wall.row + wall.height > row;
    if (!covered || right <= left) continue;
    items.push_back({{"time_s", wall.time_s},
                     {"duration_s", wall.duration_s},
                     {"lane", lane(left, row)},
                     {"lanes", right - left},
                     {"shape", "bar"},
                     {"color", kWallColor},
                     {"kind", "wall"}});
  }
}

Json itemsOf(const Level& level, const LevelFacts& facts) {
  Json items = Json::array();
  for (const Wall& wall : level.walls) addWall(wall, items);
  for (const Mine& mine : level.mines) {
    items.push_back({{"time_s", mine.time_s},
                     {"lane", lane(mine.column, mine.row)},
                     {"shape", "disc"},
                     {"color", kMineColor},
                     {"kind", "mine"}});
  }
  const std::set<std::size_t> problems(facts.parity_problems.begin(), facts.parity_problems.end());
  for (std::size_t i = 0; i < level.boxes.size(); ++i) {
    items.push_back(boxItem(level.boxes[i], problems.contains(i)));
  }
  return items;
}

Json beatsOf(const Level& level) {
  Json beats = Json::array();
  double time_s = 0.0;
  double beat_s = 60.0 / level.beats_per_minute;
  auto change = level.tempo_changes.begin();
  while (time_s <= level.length_s && beats.size() < kMostBeats) {
    beats.push_back(time_s);
    double next_s = time_s + beat_s;
    // A beat that a change cuts short is as long as its parts say.
    while (change != level.tempo_changes.end() && change->time_s < next_s) {
      const double share = (next_s - change->time_s) / beat_s;
      beat_s = 60.0 / change->beats_per_minute;
      next_s = change->time_s + share * beat_s;
      ++change;
    }
    time_s = next_s;
  }
  return beats;
}

std::string tempoText(const Level& level) {
  std::string text = fmt::format("{:g}", level.beats_per_minute);
  constexpr std::size_t kShown = 4;
  for (std::size_t i = 0; i < std::min(kShown, level.tempo_changes.size()); ++i) {
    const TempoChange& change = level.tempo_changes[i];
    text += fmt::format(", {:g} from {:.2f} s", change.beats_per_minute, change.time_s);
  }
  if (level.tempo_changes.size() > kShown) {
    text += fmt::format(" and {} changes more", level.tempo_changes.size() - kShown);
  }
  return text;
}

Json factsOf(const Level& level, const LevelFacts& facts) {
  std::string where;
  for (std::size_t i = 0; i < std::min<std::size_t>(5, facts.parity_problems.size()); ++i) {
    where += fmt::format("{}{:.2f} s", i == 0 ? ", at " : ", ",
                         level.boxes[facts.parity_problems[i]].time_s);
  }
  return {{"length", fmt::format("{:.1f} s", facts.seconds)},
          {"beats per minute", tempoText(level)},
          {"boxes", facts.boxes},
          {"links of chains", facts.links},
          {"mines", facts.mines},
          {"walls", facts.walls},
          {"boxes per second", fmt::format("{:.2f}, {:g} in the fullest second", facts.boxes_per_s,
                                           facts.peak_boxes_per_s)},
          {"approach",
           fmt::format("{:g} m/s, seen {:.2f} s before", level.speed_mps, level.approach_s)},
          {"parity problems", fmt::format("{}{}", facts.parity_problems.size(), where)},
          {"hash", level.hash}};
}

/// The level itself, in the order of its lists.
Json contentOf(const Level& level) {
  Json boxes = Json::array();
  for (const Box& box : level.boxes) {
    boxes.push_back({{"time_s", box.time_s},
                     {"column", box.column},
                     {"row", box.row},
                     {"hand", box.hand},
                     {"cut", box.cut},
                     {"angle_offset_deg", box.angle_offset_deg},
                     {"link", box.link}});
  }
  Json mines = Json::array();
  for (const Mine& mine : level.mines) {
    mines.push_back({{"time_s", mine.time_s}, {"column", mine.column}, {"row", mine.row}});
  }
  Json walls = Json::array();
  for (const Wall& wall : level.walls) {
    walls.push_back({{"time_s", wall.time_s},
                     {"duration_s", wall.duration_s},
                     {"column", wall.column},
                     {"row", wall.row},
                     {"width", wall.width},
                     {"height", wall.height}});
  }
  return {{"hash", level.hash},
          {"length_s", level.length_s},
          {"speed_mps", level.speed_mps},
          {"approach_s", level.approach_s},
          {"boxes", boxes},
          {"mines", mines},
          {"walls", walls}};
}

}  // namespace

std::string timelineJson(const Level& level) {
  const LevelFacts facts = levelFacts(level);
  Json lanes = Json::array();
  for (const char* row : {"bottom", "middle", "top"}) {
    for (int column = 0; column < kColumns; ++column) {
      lanes.push_back(fmt::format("{} {}", row, column));
    }
  }
  const Json timeline{{"name", level.name},
                      {"length_s", level.length_s},
                      {"lanes", lanes},
                      {"beats_s", beatsOf(level)},
                      {"items", itemsOf(level, facts)},
                      {"facts", factsOf(level, facts)},
                      {"level", contentOf(level)}};
  return timeline.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
#include "beats/level.hpp"

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>

#include "sim2vr/core/archive.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr double kMiddleOfColumns = 1.5;

Vec3 cellCenter_m(const Layout& layout, double column, double row, double z_m) {
  return {(column - kMiddleOfColumns) * layout.cell_width_m, rowHeight_m(layout, row), z_m};
}

double depth_m(const Level& level, const Wall& wall) {
  return std::max(wall.duration_s * level.speed_mps, kShallowestWall_m);
}

double wallHeight_m(const Layout& layout, const Wall& wall) {
  if (!layout.rows_m) return wall.height * layout.cell_height_m;
  const double bottom = wall.row - 0.5;
  return rowHeight_m(layout, bottom + wall.height) - rowHeight_m(layout, bottom);
}

std::string digits(const Archive& archive) { return fmt::format("{:016x}", archive.hash()); }

void addBoxes(Archive& archive, Level& level) {
  for (Box& box : level.boxes) {
    archive.field("time_s", box.time_s);
    archive.field("column", box.column);
    archive.field("row", box.row);
    archive.field("hand", box.hand, Hand::kRight);
    archive.field("cut", box.cut, CutDirection::kAny);
    archive.field("angle_offset_deg", box.angle_offset_deg);
    archive.field("link", box.link);
  }
}

void addMines(Archive& archive, Level& level) {
  for (Mine& mine : level.mines) {
    archive.field("time_s", mine.time_s);
    archive.field("column", mine.column);
    archive.field("row", mine.row);
  }
}

void addWalls(Archive& archive, Level& level) {
  for (Wall& wall : level.walls) {
    archive.field("time_s", wall.time_s);
    archive.field("duration_s", wall.duration_s);
    archive.field("column", wall.column);
    archive.field("row", wall.row);
    archive.field("width", wall.width);
    archive.field("height", wall.height);
  }
}

/// Follows one hand from box to box.
class Strokes {
 public:
  /// Whether the blade has to be brought back before this box.
  bool breaksParity(const Box& box) {
    const double gap_s = box.time_s - last_s_;
    Eigen::Vector2d cut = cutVector(box);
    const bool any = cut.isZero();
    const bool same_stroke = started_ && gap_s < kOneStroke_s;
    // A box that may be cut in any direction is cut on the way back.
    if (any) cut = same_stroke ? last_cut_ : Eigen::Vector2d(-last_cut_);
    constexpr double kOnwards = 1e-9;
    const bool broken =
        started_ && !same_stroke && gap_s < kBringBack_s && cut.dot(last_cut_) > kOnwards;
    started_ = true;
    last_s_ = box.time_s;
    last_cut_ = cut;
    return broken;
  }

 private:
  bool started_ = false;
  double last_s_ = 0.0;
  Eigen::Vector2d last_cut_ = Eigen::Vector2d::Zero();
};

double peak(const std::vector<Box>& boxes) {
  std::size_t most = 0;
  std::size_t first = 0;
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    while (boxes[i].time_s - boxes[first].time_s >= 1.0) ++first;
    most = std::max(most, i - first + 1);
  }
  return static_cast<double>(most);
}

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

TempoMap::TempoMap(double beats_per_minute, const std::vector<Change>& changes)
    : pieces_{{0.0, 0.0, 60.0 / beats_per_minute}} {
  for (const Change& change : changes) {
    const double time_s = raw(change.beat);
    if (change.beat <= pieces_.back().beat) pieces_.pop_back();
    pieces_.push_back({change.beat, time_s, 60.0 / change.beats_per_minute});
  }
}

TempoMap::TempoMap(const std::vector<Region>& regions) {
  for (const Region& region : regions) {
    const double beats = region.end_beat - region.start_beat;
    pieces_.push_back({region.start_beat, region.start_s, (region.end_s - region.start_s) / beats});
  }
}

double TempoMap::raw(double beat) const {
  const Piece& found = piece(beat);
  return found.time_s + (beat - found.beat) * found.beat_s;
}

const TempoMap::Piece& TempoMap::piece(double beat) const {
  const auto behind = std::upper_bound(
      pieces_.begin(), pieces_.end(), beat,
      [](double wanted, const Piece& candidate) { return wanted < candidate.beat; });
  return behind == pieces_.begin() ? pieces_.front() : *(behind - 1);
}

Eigen::Vector2d directionVector(CutDirection direction) {
  // In the order of CutDirection.
  constexpr double kHalf = std::numbers::sqrt2 / 2.0;
  constexpr std::array<std::array<double, 2>, 9> kVectors{{{0.0, 1.0},
                                                           {0.0, -1.0},
                                                           {-1.0, 0.0},
                                                           {1.0, 0.0},
                                                           {-kHalf, kHalf},
                                                           {kHalf, kHalf},
                                                           {-kHalf, -kHalf},
                                                           {kHalf, -kHalf},
                                                           {0.0, 0.0}}};
  const auto& vector = kVectors[static_cast<std::size_t>(direction)];
  return {vector[0], vector[1]};
}

Eigen::Vector2d cutVector(const Box& box) {
  const double angle_rad = box.angle_offset_deg * std::numbers::pi / 180.0;
  return Eigen::Rotation2Dd(angle_rad) * directionVector(box.cut);
}

CutDirection opposite(CutDirection direction) {
  using enum CutDirection;
  constexpr std::array kOpposites{kDown,     kUp,      kRight,  kLeft, kDownRight,
                                  kDownLeft, kUpRight, kUpLeft, kAny};
  return kOpposites[static_cast<std::size_t>(direction)];
}

double rowHeight_m(const Layout& layout, double row) {
  if (!layout.rows_m) return layout.middle_row_m + (row - 1.0) * layout.cell_height_m;
  const auto& [bottom, middle, top] = *layout.rows_m;
  return middle + (row - 1.0) * (row < 1.0 ? middle - bottom : top - middle);
}

// A mark that points down points along the cut when it is turned by this.
double boxTurn_rad(const Box& box) {
  if (box.cut == CutDirection::kAny) return box.angle_offset_deg * std::numbers::pi / 180.0;
  const Eigen::Vector2d cut = cutVector(box);
  return std::atan2(cut.x(), -cut.y());
}

Block boxAt(const Layout& layout, const Level& level, const Box& box, double time_s) {
  const double z_m = layout.cut_distance_m + level.speed_mps * (box.time_s - time_s);
  const double edge_m = box.link ? layout.link_edge_m : layout.box_edge_m;
  return {cellCenter_m(layout, box.column, box.row, z_m), Vec3::Constant(edge_m / 2.0),
          boxTurn_rad(box)};
}

Block mineAt(const Layout& layout, const Level& level, const Mine& mine, double time_s) {
  const double z_m = layout.cut_distance_m + level.speed_mps * (mine.time_s - time_s);
  return {cellCenter_m(layout, mine.column, mine.row, z_m), Vec3::Zero(), 0.0};
}

Block wallAt(const Layout& layout, const Level& level, const Wall& wall, double time_s) {
  const Vec3 size(wall.width * layout.cell_width_m, wallHeight_m(layout, wall),
                  depth_m(level, wall));
  // The lower left edge of cell (column, row) lies half a cell from its middle.
  const Vec3 corner = cellCenter_m(layout, wall.column - 0.5, wall.row - 0.5,
                                   level.speed_mps * (wall.time_s - time_s));
  return {corner + size / 2.0, size / 2.0, 0.0};
}

double passTime_s(const Layout& layout, const Level& level, double time_s) {
  return time_s + layout.cut_distance_m / level.speed_mps;
}

double goneTime_s(const Level& level, const Wall& wall) {
  return wall.time_s + (depth_m(level, wall) + kWallGone_m) / level.speed_mps;
}

std::string bytesHash(std::string_view bytes) {
  Archive archive = Archive::saver();
  std::string copy(bytes);
  archive.field("bytes", copy);
  return digits(archive);
}

std::string contentHash(Level level) {
  Archive archive = Archive::saver();
  archive.field("name", level.name);
  archive.field("length_s", level.length_s);
  archive.field("beats_per_minute", level.beats_per_minute);
  archive.field("speed_mps", level.speed_mps);
  archive.field("approach_s", level.approach_s);
  for (TempoChange& change : level.tempo_changes) {
    archive.field("time_s", change.time_s);
    archive.field("beats_per_minute", change.beats_per_minute);
  }
  addBoxes(archive, level);
  addMines(archive, level);
  addWalls(archive, level);
  return digits(archive);
}

LevelFacts levelFacts(const Level& level) {
  LevelFacts facts;
  std::vector<Box> boxes;
  Strokes left;
  Strokes right;
  for (std::size_t i = 0; i < level.boxes.size(); ++i) {
    const Box& box = level.boxes[i];
    if (box.link) {
      ++facts.links;
      continue;
    }
    boxes.push_back(box);
    if ((box.hand == Hand::kLeft ? left : right).breaksParity(box)) {
      facts.parity_problems.push_back(i);
    }
  }
  facts.boxes = boxes.size();
  facts.mines = level.mines.size();
  facts.walls = level.walls.size();
  facts.seconds = level.length_s;
  facts.peak_boxes_per_s = peak(boxes);
  const double span_s = boxes.empty() ? 0.0 : boxes.back().time_s - boxes.front().time_s;
  if (span_s > 0.0) facts.boxes_per_s = static_cast<double>(boxes.size() - 1) / span_s;
  return facts;
}

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

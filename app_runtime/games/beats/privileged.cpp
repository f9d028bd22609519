// SPDX-License-Identifier: Apache-2.0
#include "beats/privileged.hpp"

#include <algorithm>
#include <array>
#include <optional>

#include "beats/directions.hpp"
#include "sim2vr/rl/privileged_table.hpp"

namespace sim2vr::games::beats {
namespace {

// What the table's getters read: of what comes only what the head camera has shown. Nothing comes
// any more when a round is over.
struct Source {
  Source(const Round& the_round, const Sight& the_sight)
      : round(the_round),
        sight(the_sight),
        over(round.phase() == Round::Phase::kDone),
        head_m(round.head().transform().position()) {
    if (over) return;
    boxes = {sight.boxes(Hand::kLeft), sight.boxes(Hand::kRight)};
    mines = sight.mines();
    walls = sight.walls();
  }

  const Round& round;
  const Sight& sight;
  bool over;
  Vec3 head_m;
  std::array<std::vector<std::size_t>, 2> boxes;  // by hand
  std::vector<std::size_t> mines, walls;
};

using Table = rl::PrivilegedTable<Source>;

void addSaber(Table& table, Hand hand) {
  const std::string prefix = hand == Hand::kLeft ? "left." : "right.";
  // Without a held saber all of its numbers are 0.
  const auto add = [&](const std::string& name, const std::string& unit, auto value) {
    table.vector(prefix + name, unit, [=](const Source& s) {
      const Saber& saber = s.round.saber(hand);
      return saber.held() ? Vec3(value(s, saber)) : Vec3(Vec3::Zero());
    });
  };
  add("root_", "_m", [](const Source& s, const Saber& saber) -> Vec3 {
    return saber.segment().root_m - s.head_m;
  });
  add("axis_", "", [](const Source&, const Saber& saber) -> Vec3 {
    const Segment blade = saber.segment();
    return (blade.tip_m - blade.root_m).normalized();
  });
  add("tip_v", "_mps", [](const Source&, const Saber& saber) { return saber.tipVelocity_mps(); });
  table.number(prefix + "on", [=](const Source& s) { return s.round.saber(hand).held(); });
}

void addBox(Table& table, Hand hand, std::size_t i) {
  const std::string prefix = (hand == Hand::kLeft ? "left" : "right") + std::to_string(i) + ".";
  const auto index = [=](const Source& s) -> std::optional<std::size_t> {
    const auto& boxes = s.boxes[static_cast<std::size_t>(hand)];
    return i < boxes.size() ? std::optional(boxes[i]) : std::nullopt;
  };
  table.number(prefix + "present", [=](const Source& s) { return index(s).has_value(); });
  table.number(prefix + "time_s", [=](const Source& s) {
    const auto box = index(s);
    return box ? s.round.level().boxes[*box].time_s - s.round.time_s() : 0.0;
  });
  table.vector(prefix, "_m", [=](const Source& s) {
    const auto box = index(s);
    return box ? Vec3(s.round.box(*box).center_m - s.head_m) : Vec3(Vec3::Zero());
  });
  for (int axis = 0; axis < 2; ++axis) {
    table.number(prefix + "dir_" + "xy"[axis], [=](const Source& s) {
      const auto box = index(s);
      return box ? cutVector(s.round.level().boxes[*box])[axis] : 0.0;
    });
  }
}

void addMine(Table& table, std::size_t i) {
  const std::string prefix = "mine" + std::to_string(i) + ".";
  table.number(prefix + "present", [=](const Source& s) { return i < s.mines.size(); });
  table.number(prefix + "time_s", [=](const Source& s) {
    return i < s.mines.size() ? s.round.level().mines[s.mines[i]].time_s - s.round.time_s() : 0.0;
  });
  table.vector(prefix, "_m", [=](const Source& s) {
    return i < s.mines.size() ? Vec3(s.round.mine(s.mines[i]).center_m - s.head_m)
                              : Vec3(Vec3::Zero());
  });
}

void addWall(Table& table, std::size_t i) {
  const std::string prefix = "wall" + std::to_string(i) + ".";
  table.number(prefix + "present", [=](const Source& s) { return i < s.walls.size(); });
  const auto add = [&](const std::string& name, auto value) {
    table.number(prefix + name, [=](const Source& s) {
      return i < s.walls.size() ? value(s, s.round.wall(s.walls[i])) : 0.0;
    });
  };
  for (const double side : {-1.0, 1.0}) {
    add(side < 0.0 ? "start_s" : "end_s", [=](const Source& s, const Block& wall) {
      const double ahead_m = wall.center_m.z() - s.round.origin_m().z();
      return (ahead_m + side * wall.half_m.z()) / s.round.level().speed_mps;
    });
  }
  constexpr std::array kSides{"left_m", "right_m", "bottom_m", "top_m"};
  for (int i_side = 0; i_side < 4; ++i_side) {
    const int axis = i_side / 2;
    const double side = i_side % 2 == 0 ? -1.0 : 1.0;
    add(kSides[static_cast<std::size_t>(i_side)], [=](const Source& s, const Block& wall) {
      return wall.center_m[axis] + side * wall.half_m[axis] - s.head_m[axis];
    });
  }
}

// Of the head's sphere in the cross section, seen from the front; negative outside.
double depthInWall_m(const Source& s) {
  if (s.walls.empty()) return 0.0;
  const Block wall = s.round.wall(s.walls.front());
  const Vec3 outside = (s.head_m - wall.center_m).cwiseAbs() - wall.half_m;
  return s.round.layout().head_radius_m - std::max(outside.x(), outside.y());
}

Table makeTable() {
  Table table;
  table.vector("head.", "_m",
               [](const Source& s) -> Vec3 { return s.head_m - s.round.origin_m(); });
  for (const Hand hand : {Hand::kLeft, Hand::kRight}) addSaber(table, hand);
  for (const Hand hand : {Hand::kLeft, Hand::kRight}) {
    for (std::size_t i = 0; i < kShownBoxes; ++i) addBox(table, hand, i);
  }
  for (std::size_t i = 0; i < kShownMines; ++i) addMine(table, i);
  for (std::size_t i = 0; i < kShownWalls; ++i) addWall(table, i);
  table.number("round.speed_mps", [](const Source& s) { return s.round.level().speed_mps; });
  for (const Hand hand : {Hand::kLeft, Hand::kRight}) {
    table.number(hand == Hand::kLeft ? "aid.left_m" : "aid.right_m", [=](const Source& s) {
      return s.over ? 0.0 : s.sight.bladeToBox_m(hand).value_or(0.0);
    });
  }
  table.number("aid.wall_m", depthInWall_m);
  table.number("aid.score", [](const Source& s) { return s.round.tally().score(); });
  table.number("aid.misses", [](const Source& s) { return s.round.tally().misses(); });
  table.number("aid.errors", [](const Source& s) { return s.round.tally().errors(); });
  table.number("aid.slices", [](const Source& s) { return s.round.tally().slices(); });
  return table;
}

const Table& table() {
  static const Table table = makeTable();
  return table;
}

}  // namespace

const std::vector<std::string>& privilegedNames() { return table().names(); }

void writePrivileged(const Round& round, const Sight& sight, std::span<float> values) {
  table().fill(Source(round, sight), values);
}

}  // namespace sim2vr::games::beats

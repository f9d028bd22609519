#include "beats/privileged.hpp"

#include <algorithm>
#include <array>

#include "beats/directions.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/rl/number_writer.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr std::array<Hand, 2> kHands{Hand::kLeft, Hand::kRight};

const char* nameOf(Hand hand) { return hand == Hand::kLeft ? "left" : "right"; }

void addNames(std::vector<std::string>& names, const std::string& prefix,
              std::initializer_list<const char*> numbers) {
  for (const char* number : numbers) names.push_back(prefix + number);
}

std::vector<std::string> allNames() {
  std::vector<std::string> names;
  addNames(names, "head.", {"x_m", "y_m", "z_m"});
  for (const Hand hand : kHands) {
    addNames(names, std::string(nameOf(hand)) + ".",
             {"root_x_m", "root_y_m", "root_z_m", "axis_x", "axis_y", "axis_z", "tip_vx_mps",
              "tip_vy_mps", "tip_vz_mps", "on"});
  }
  for (const Hand hand : kHands) {
    for (std::size_t i = 0; i < kToldBoxes; ++i) {
      addNames(names, nameOf(hand) + std::to_string(i) + ".",
               {"present", "time_s", "x_m", "y_m", "z_m", "dir_x", "dir_y"});
    }
  }
  for (std::size_t i = 0; i < kToldMines; ++i) {
    addNames(names, "mine" + std::to_string(i) + ".", {"present", "time_s", "x_m", "y_m", "z_m"});
  }
  for (std::size_t i = 0; i < kToldWalls; ++i) {
    addNames(names, "wall" + std::to_string(i) + ".",
             {"present", "start_s", "end_s", "left_m", "right_m", "bottom_m", "top_m"});
  }
  addNames(names, "round.", {"speed_mps"});
  addNames(names, "aid.", {"left_m", "right_m", "wall_m", "score", "misses", "errors", "slices"});
  return names;
}

class Writer : private rl::NumberWriter {
 public:
  Writer(const Round& round, const Sight& sight, std::span<float> values)
      : NumberWriter(values), round_(round), sight_(sight) {}

  void writeAll() {
    vector(head_m_ - round_.origin_m());
    for (const Hand hand : kHands) writeSaber(round_.saber(hand));
    // What is still there when a round is over is no business of anybody's.
    const bool over = round_.phase() == Round::Phase::kDone;
    const auto told = [over](std::vector<std::size_t> all) {
      return over ? std::vector<std::size_t>() : all;
    };
    for (const Hand hand : kHands) writeBoxes(told(sight_.boxes(hand)));
    writeMines(told(sight_.mines()));
    const std::vector<std::size_t> walls = told(sight_.walls());
    writeWalls(walls);
    number(round_.level().speed_mps);
    for (const Hand hand : kHands) number(over ? 0.0 : sight_.bladeToBox_m(hand).value_or(0.0));
    number(walls.empty() ? 0.0 : depthInWall_m(round_.wall(walls.front())));
    writeTally();
  }

 private:
  void nothing(int count) {
    for (int i = 0; i < count; ++i) number(0.0);
  }

  void writeSaber(const Saber& saber) {
    if (!saber.held()) return nothing(10);
    const Segment blade = saber.segment();
    vector(blade.root_m - head_m_);
    vector((blade.tip_m - blade.root_m).normalized());
    vector(saber.tipVelocity_mps());
    number(1.0);
  }

  void writeBoxes(const std::vector<std::size_t>& boxes) {
    for (std::size_t i = 0; i < kToldBoxes; ++i) {
      if (i >= boxes.size()) {
        nothing(7);
        continue;
      }
      const Box& box = round_.level().boxes[boxes[i]];
      number(1.0);
      number(box.time_s - round_.time_s());
      vector(round_.box(boxes[i]).center_m - head_m_);
      const Eigen::Vector2d cut = cutVector(box);
      number(cut.x());
      number(cut.y());
    }
  }

  void writeMines(const std::vector<std::size_t>& mines) {
    for (std::size_t i = 0; i < kToldMines; ++i) {
      if (i >= mines.size()) {
        nothing(5);
        continue;
      }
      number(1.0);
      number(round_.level().mines[mines[i]].time_s - round_.time_s());
      vector(round_.mine(mines[i]).center_m - head_m_);
    }
  }

  void writeWalls(const std::vector<std::size_t>& walls) {
    const double head_plane_m = round_.origin_m().z();
    for (std::size_t i = 0; i < kToldWalls; ++i) {
      if (i >= walls.size()) {
        nothing(7);
        continue;
      }
      const Block wall = round_.wall(walls[i]);
      const double ahead_m = wall.center_m.z() - head_plane_m;
      const double speed_mps = round_.level().speed_mps;
      number(1.0);
      number((ahead_m - wall.half_m.z()) / speed_mps);
      number((ahead_m + wall.half_m.z()) / speed_mps);
      for (int axis = 0; axis < 2; ++axis) {
        for (const double side : {-1.0, 1.0}) {
          number(wall.center_m[axis] + side * wall.half_m[axis] - head_m_[axis]);
        }
      }
    }
  }

  // Of the head's sphere in the cross section, seen from the front; negative outside.
  double depthInWall_m(const Block& wall) const {
    const Vec3 outside = (head_m_ - wall.center_m).cwiseAbs() - wall.half_m;
    return round_.layout().head_radius_m - std::max(outside.x(), outside.y());
  }

  void writeTally() {
    const Tally& tally = round_.tally();
    number(tally.score());
    number(tally.misses());
    number(tally.errors());
    number(tally.slices());
  }

  const Round& round_;
  const Sight& sight_;
  Vec3 head_m_ = round_.head().transform().position();
};

}  // namespace

const std::vector<std::string>& privilegedNames() {
  static const std::vector<std::string> names = allNames();
  return names;
}

void writePrivileged(const Round& round, const Sight& sight, std::span<float> values) {
  if (values.size() != privilegedNames().size()) {
    throw InvalidArgument("values", std::to_string(values.size()) + " numbers",
                          std::to_string(privilegedNames().size()));
  }
  Writer(round, sight, values).writeAll();
}

}  // namespace sim2vr::games::beats

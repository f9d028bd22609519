// SPDX-License-Identifier: Apache-2.0
#include "beats/level_facts.hpp"

#include <algorithm>

#include "beats/directions.hpp"

namespace sim2vr::games::beats {
namespace {

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

}  // namespace

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

}  // namespace sim2vr::games::beats

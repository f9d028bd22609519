#include "beats/chain.hpp"

#include <algorithm>

#include "beats/directions.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr double kSameTime_s = 1e-3;

bool isThere(const Box& head, const std::vector<Box>& boxes) {
  auto box = std::lower_bound(
      boxes.begin(), boxes.end(), head.time_s - kSameTime_s,
      [](const Box& candidate, double time_s) { return candidate.time_s < time_s; });
  for (; box != boxes.end() && box->time_s <= head.time_s + kSameTime_s; ++box) {
    if (box->hand == head.hand && box->column == head.column && box->row == head.row) return true;
  }
  return false;
}

}  // namespace

std::vector<Box> chainBoxes(const Chain& chain, double head_s, double tail_s,
                            const std::vector<Box>& boxes) {
  std::vector<Box> added;
  Box head = chain.head;
  head.time_s = head_s;
  if (head.cut == CutDirection::kAny) head.cut = CutDirection::kDown;
  if (!isThere(head, boxes)) added.push_back(head);
  const Eigen::Vector2d begin(head.column, head.row);
  const Eigen::Vector2d end(chain.tail_column, chain.tail_row);
  const Eigen::Vector2d middle = begin + cutVector(head) * (end - begin).norm() / 2.0;
  for (int i = 1; i < chain.slices; ++i) {
    const double share = static_cast<double>(i) / (chain.slices - 1);
    const double t = share * chain.squish;
    const Eigen::Vector2d place =
        (1.0 - t) * (1.0 - t) * begin + 2.0 * (1.0 - t) * t * middle + t * t * end;
    Box link{head_s + share * (tail_s - head_s), place.x(), place.y(), head.hand};
    link.link = true;
    added.push_back(link);
  }
  return added;
}

}  // namespace sim2vr::games::beats

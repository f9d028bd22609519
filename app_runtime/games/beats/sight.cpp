// SPDX-License-Identifier: Apache-2.0
#include "beats/sight.hpp"

#include <algorithm>
#include <array>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/rl/view_frustum.hpp"

namespace sim2vr::games::beats {
namespace {

// The middle and the corners of the side that faces the player.
std::array<Vec3, 5> frontPoints(const Block& wall) {
  const Vec3 front = wall.center_m - Vec3(0.0, 0.0, wall.half_m.z());
  const double x = wall.half_m.x(), y = wall.half_m.y();
  return {front, front + Vec3(x, y, 0.0), front + Vec3(x, -y, 0.0), front + Vec3(-x, y, 0.0),
          front + Vec3(-x, -y, 0.0)};
}

void transferFlags(Archive& archive, std::string_view name, std::vector<std::uint8_t>& flags) {
  const std::size_t count = flags.size();
  archive.field(name, flags);
  if (flags.size() != count) {
    throw EngineError("saved state: a level with another number of things");
  }
}

}  // namespace

Sight::Sight(const Round& round, double aspect)
    : round_(&round),
      aspect_(aspect),
      boxes_(round.level().boxes.size(), 0),
      mines_(round.level().mines.size(), 0),
      walls_(round.level().walls.size(), 0) {}

void Sight::look() {
  const auto& camera = *round_->head().getComponent<render::Camera>();
  const auto visible = [&](const Vec3& point_m) { return rl::inView(camera, aspect_, point_m); };
  for (const std::size_t i : round_->boxesOut()) {
    if (boxes_[i] == 0 && visible(round_->box(i).center_m)) boxes_[i] = 1;
  }
  for (const std::size_t i : round_->minesOut()) {
    if (mines_[i] == 0 && visible(round_->mine(i).center_m)) mines_[i] = 1;
  }
  for (const std::size_t i : round_->wallsOut()) {
    if (walls_[i] == 0 && std::ranges::any_of(frontPoints(round_->wall(i)), visible)) walls_[i] = 1;
  }
}

std::vector<std::size_t> Sight::seen(std::vector<std::size_t> out, const Flags& flags) {
  std::erase_if(out, [&flags](std::size_t i) { return flags[i] == 0; });
  return out;
}

std::vector<std::size_t> Sight::boxes(Hand hand) const {
  std::vector<std::size_t> of_hand = boxes();
  std::erase_if(of_hand, [&](std::size_t i) { return round_->level().boxes[i].hand != hand; });
  return of_hand;
}

std::optional<double> Sight::bladeToBox_m(Hand hand) const {
  const std::vector<std::size_t> next = boxes(hand);
  const Saber& saber = round_->saber(hand);
  if (next.empty() || !saber.held()) return std::nullopt;
  const double gap_m = distance_m(saber.segment(), round_->box(next.front())) - kBladeRadius_m;
  return std::max(0.0, gap_m);
}

void Sight::fields(Archive& archive) {
  transferFlags(archive, "boxes", boxes_);
  transferFlags(archive, "mines", mines_);
  transferFlags(archive, "walls", walls_);
}

}  // namespace sim2vr::games::beats

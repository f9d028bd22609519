// SPDX-License-Identifier: Apache-2.0
// What the player has been able to see. Teachers and shaped rewards may know that and no more.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "beats/round.hpp"
#include "sim2vr/core/archive.hpp"

namespace sim2vr::games::beats {

class Sight {
 public:
  /// `aspect`: width / height of the headset image. The round outlives it.
  Sight(const Round& round, double aspect);

  /// At the end of every frame: notices what has come into view. Nothing hides anything.
  void look();

  // Those that are out and have been in view, by index in the level, in order of time.
  std::vector<std::size_t> boxes() const { return seen(round_->boxesOut(), boxes_); }
  std::vector<std::size_t> boxes(Hand hand) const;
  std::vector<std::size_t> mines() const { return seen(round_->minesOut(), mines_); }
  std::vector<std::size_t> walls() const { return seen(round_->wallsOut(), walls_); }
  /// From the hand's blade to the surface of its next box.
  std::optional<double> bladeToBox_m(Hand hand) const;

  void fields(Archive& archive);

 private:
  using Flags = std::vector<std::uint8_t>;
  static std::vector<std::size_t> seen(std::vector<std::size_t> out, const Flags& flags);

  const Round* round_;
  double aspect_;
  Flags boxes_, mines_, walls_;
};

}  // namespace sim2vr::games::beats

// SPDX-License-Identifier: Apache-2.0
// Puts the stylus' tip where a test wants it.
#pragma once

#include <cstdint>
#include <string>

#include "game_harness.hpp"
#include "pointing/game.hpp"
#include "pointing/round.hpp"

namespace sim2vr::games::pointing {

/// A round with a player whose stylus looks ahead. Frames are 50 ms apart.
class PointingRound {
 public:
  static constexpr std::int64_t kPeriod_ns = 50'000'000;
  static constexpr double kStylus_m = 0.10;

  explicit PointingRound(const std::string& options_json = "{}", std::uint32_t seed = 1,
                         rl::EpisodeLogger* logger = nullptr)
      : harness(game, seed, options_json, testing::referenceTime(), 0, logger) {}

  void frame(const Vec3& tip_m) {
    const Pose controller{tip_m - Vec3(0.0, 0.0, kStylus_m), Quat::Identity()};
    harness.frame(frames_++ * kPeriod_ns, {{head_m, head_rotation}, controller, 0.0F, hand});
  }
  void idle(int frames = 1) {
    for (int i = 0; i < frames; ++i) frame(head_m + Vec3(0.0, -0.5, 0.1));
  }

  /// A tap in two frames: 2 cm before the plane, and 2 cm behind it, so that the tip comes through
  /// half a frame before the second one. `place_m`: in the plane, from the target's centre.
  void tap(const Vec3& place_m = Vec3::Zero()) {
    const Vec3 aim_m = round().targetCenter(round().target()) + place_m;
    frame(aim_m - Vec3(0.0, 0.0, 0.02));
    frame(aim_m + Vec3(0.0, 0.0, 0.02));
  }

  const Round& round() { return *harness.all<Round>().at(0); }
  double log(const std::string& name) { return harness.log(name); }

  Pointing game;
  testing::GameHarness harness;
  Vec3 head_m{0.0, 1.2, 0.0};
  Quat head_rotation = Quat::Identity();
  xr::Hand hand = xr::Hand::right;

 private:
  std::int64_t frames_ = 0;
};

}  // namespace sim2vr::games::pointing

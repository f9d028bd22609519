// SPDX-License-Identifier: Apache-2.0
// What the player feels and hears.
#pragma once

#include <string_view>

#include "beats/level.hpp"
#include "sim2vr/core/math.hpp"
#include "sim2vr/rl/sound.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::beats {

class Feedback {
 public:
  /// Makes the game's action set, before the rig attaches all of them. Both outlive it.
  Feedback(xr::Session& session, rl::SoundLog& sounds);

  void slice(Hand hand, const Vec3& place_m);
  void wrongCut(Hand hand, const Vec3& place_m);
  void mine(Hand hand, const Vec3& place_m);
  /// The head comes into a wall: both hands feel it.
  void wall(const Vec3& place_m);
  void miss(const Vec3& place_m);

 private:
  struct Pulse {
    int milliseconds;
    float amplitude;
  };
  void vibrate(Hand hand, const Pulse& pulse);
  void play(std::string_view sound, const Vec3& place_m);

  xr::Session* session_;
  rl::SoundLog* sounds_;
  const xr::Action* vibration_;
};

}  // namespace sim2vr::games::beats

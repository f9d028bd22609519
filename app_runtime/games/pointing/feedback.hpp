// SPDX-License-Identifier: Apache-2.0
// What the player hears and feels.
#pragma once

#include <string_view>

#include "sim2vr/core/math.hpp"
#include "sim2vr/rl/sound.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::pointing {

class Feedback {
 public:
  /// Makes the game's action set, before the rig attaches all of them. Both outlive it.
  Feedback(xr::Session& session, rl::SoundLog& sounds, xr::Hand hand);

  void hit(const Vec3& place_m) { selection("hit", place_m); }
  void error(const Vec3& place_m) { selection("error", place_m); }
  void timeout(const Vec3& place_m) { sounds_->play({"timeout", place_m}); }

 private:
  /// Touching the plane is felt wherever it is touched.
  void selection(std::string_view sound, const Vec3& place_m);

  xr::Session* session_;
  rl::SoundLog* sounds_;
  xr::Hand hand_;
  const xr::Action* vibration_;
};

}  // namespace sim2vr::games::pointing

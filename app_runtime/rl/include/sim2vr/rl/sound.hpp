// SPDX-License-Identifier: Apache-2.0
// What the player hears. Nothing is played: a sound is an event with a name, a place and a gain,
// and the listener decides what it is worth.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/core/math.hpp"
#include "sim2vr/scene/component.hpp"

namespace sim2vr::rl {

struct SoundEvent {
  std::string name;
  Vec3 position_m = Vec3::Zero();  // world, app frame
  float gain = 1.0F;               // 1: as loud as it was recorded
};

/// The sounds of one round, until they are taken. Not part of saved states.
class SoundLog {
 public:
  /// Throws InvalidArgument for an empty name, a place that is not finite and a gain outside 0
  /// .. 1.
  void play(SoundEvent event);
  /// Those since the last call, in order.
  std::vector<SoundEvent> take();

 private:
  std::vector<SoundEvent> events_;
};

/// Unity's AudioSource, as far as a lockstep world needs it: sounds from where its object is.
class AudioSource : public scene::Component {
 public:
  explicit AudioSource(SoundLog& sounds) : sounds_(sounds) {}
  std::string_view typeName() const override { return "AudioSource"; }

  /// Throws as SoundLog::play does.
  void PlayOneShot(std::string_view name, float gain = 1.0F);

 private:
  SoundLog& sounds_;
};

}  // namespace sim2vr::rl

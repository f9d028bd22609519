// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/rl/sound.hpp"

#include <utility>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "sim2vr/scene/transform.hpp"

namespace sim2vr::rl {

void SoundLog::play(SoundEvent event) {
  if (event.name.empty()) throw InvalidArgument("sound.name", "''", "a name");
  if (!event.position_m.allFinite()) {
    throw InvalidArgument("sound.position_m", "a number that is not finite", "metres");
  }
  if (!(event.gain >= 0.0F && event.gain <= 1.0F)) {
    throw InvalidArgument("sound.gain", std::to_string(event.gain), "a number from 0 to 1");
  }
  events_.push_back(std::move(event));
}

std::vector<SoundEvent> SoundLog::take() { return std::exchange(events_, {}); }

void AudioSource::PlayOneShot(std::string_view name, float gain) {
  sounds_.play({std::string(name), transform().position(), gain});
}

}  // namespace sim2vr::rl

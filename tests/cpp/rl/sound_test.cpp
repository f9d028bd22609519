// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/rl/sound.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <string>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::rl {
namespace {

std::string errorOf(SoundLog& sounds, const SoundEvent& event) {
  try {
    sounds.play(event);
  } catch (const InvalidArgument& error) {
    return error.what();
  }
  return "";
}

TEST(Sound, ComesFromWhereItsObjectIs) {
  scene::Scene scene;
  SoundLog sounds;
  scene::GameObject& object = scene.create("Bell");
  object.transform().setPosition({1.0, 2.0, 3.0});
  object.addComponent<AudioSource>(sounds).PlayOneShot("bell", 0.5F);
  const std::vector<SoundEvent> heard = sounds.take();
  ASSERT_EQ(heard.size(), 1U);
  EXPECT_EQ(heard[0].name, "bell");
  EXPECT_EQ(heard[0].position_m, Vec3(1.0, 2.0, 3.0));
  EXPECT_EQ(heard[0].gain, 0.5F);
  EXPECT_TRUE(sounds.take().empty());
}

TEST(Sound, RefusesWhatIsNoSound) {
  SoundLog sounds;
  EXPECT_EQ(errorOf(sounds, {"", Vec3::Zero(), 1.0F}), "sound.name: got '', expected a name");
  EXPECT_EQ(errorOf(sounds, {"x", Vec3(0, std::numeric_limits<double>::infinity(), 0), 1.0F}),
            "sound.position_m: got a number that is not finite, expected metres");
  EXPECT_EQ(errorOf(sounds, {"x", Vec3::Zero(), 1.5F}),
            "sound.gain: got 1.500000, expected a number from 0 to 1");
}

}  // namespace
}  // namespace sim2vr::rl

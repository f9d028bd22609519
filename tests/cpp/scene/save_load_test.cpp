// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "recorder.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::scene {
namespace {

// Counts frames and makes one target every second frame; targets fall and vanish below 0.
class Target : public Component {
 public:
  std::string_view typeName() const override { return "Target"; }
  void Start() override { started_times = 1; }
  void Update() override {
    height -= 0.25;
    transform().setLocalPosition(Vec3(0.0, height, 0.0));
    if (height < 0.0) scene().destroy(gameObject());
  }
  void fields(Archive& archive) override {
    archive.field("height", height);
    archive.field("started_times", started_times);
  }

  double height = 1.0;
  int started_times = 0;
};

class Spawner : public Component {
 public:
  std::string_view typeName() const override { return "Spawner"; }
  void Update() override {
    if (frames++ % 2 == 0) {
      scene().instantiate("Target", "Target " + std::to_string(frames), &gameObject());
    }
  }
  void fields(Archive& archive) override { archive.field("frames", frames); }

  int frames = 0;
};

std::unique_ptr<Scene> buildGame() {
  auto scene = std::make_unique<Scene>(oneStepPerFrame());
  scene->registerPrefab("Target", [raw = scene.get()](GameObject& object) {
    object.addComponent<Target>();
    raw->create("Ring", &object).transform().setLocalScale(2.0);
  });
  scene->create("Area").addComponent<Spawner>();
  return scene;
}

void play(Scene& scene, std::int64_t from, std::int64_t to) {
  for (std::int64_t frame = from; frame <= to; ++frame) scene.runFrame(frame * kFrame_ns, [] {});
}

std::string save(Scene& scene) {
  Archive archive = Archive::saver();
  scene.fields(archive);
  return archive.bytes();
}

void load(Scene& scene, const std::string& bytes) {
  Archive archive = Archive::loader(bytes);
  scene.fields(archive);
  archive.expectEnd();
}

TEST(SaveLoad, FreshSceneContinuesBitForBit) {
  const auto original = buildGame();
  play(*original, 1, 7);
  const std::string state = save(*original);
  const auto fresh = buildGame();
  load(*fresh, state);
  EXPECT_EQ(save(*fresh), state);
  EXPECT_GT(fresh->objects().size(), 3U) << "targets and their rings came along";
  for (std::int64_t frame = 8; frame <= 20; ++frame) {
    play(*original, frame, frame);
    play(*fresh, frame, frame);
    ASSERT_EQ(save(*fresh), save(*original)) << "frame " << frame;
  }
}

TEST(SaveLoad, SceneInUseGoesBackToAnEarlierState) {
  const auto scene = buildGame();
  play(*scene, 1, 5);
  const std::string early = save(*scene);
  play(*scene, 6, 16);
  const std::string late = save(*scene);
  load(*scene, early);
  EXPECT_EQ(save(*scene), early);
  play(*scene, 6, 16);
  EXPECT_EQ(save(*scene), late);
}

TEST(SaveLoad, StartIsNotCalledAgainForAStartedTarget) {
  const auto scene = buildGame();
  play(*scene, 1, 2);
  scene->forEach<Target>([](Target& target) { target.started_times = 7; });
  const auto fresh = buildGame();
  load(*fresh, save(*scene));
  play(*fresh, 3, 3);
  int count = 0;
  fresh->forEach<Target>([&](Target& target) {
    if (target.started_times == 7) ++count;
  });
  EXPECT_EQ(count, 1);
}

TEST(SaveLoad, ActiveFlagsComeAlong) {
  const auto scene = buildGame();
  play(*scene, 1, 2);
  scene->find("Area")->setActive(false);
  const auto fresh = buildGame();
  load(*fresh, save(*scene));
  EXPECT_FALSE(fresh->find("Area")->activeInHierarchy());
  play(*fresh, 3, 6);
  EXPECT_EQ(fresh->find("Area")->getComponent<Spawner>()->frames, 2) << "asleep";
}

TEST(SaveLoad, ChildOfAPrefabThatWasDestroyedStaysAway) {
  const auto scene = buildGame();
  play(*scene, 1, 4);
  scene->destroy(*scene->find("Area/Target 1/Ring"));
  const std::string state = save(*scene);
  const auto fresh = buildGame();
  load(*fresh, state);
  EXPECT_EQ(fresh->find("Area/Target 1/Ring"), nullptr);
  EXPECT_NE(fresh->find("Area/Target 3/Ring"), nullptr);
  EXPECT_EQ(save(*fresh), state);
}

TEST(SaveLoad, ObjectsOfAnotherGameAreRefused) {
  Scene other(oneStepPerFrame());
  other.create("Area");
  other.create("Beat Saber");
  const auto scene = buildGame();
  try {
    load(*scene, save(other));
    FAIL() << "no error";
  } catch (const EngineError& error) {
    EXPECT_STREQ(
        error.what(),
        "saved state: object 'Beat Saber' is unknown here; the state was made with another "
        "game or options");
  }
}

TEST(SaveLoad, ComponentsOfAnotherTypeAreRefused) {
  Scene other(oneStepPerFrame());
  other.create("Area").addComponent<Target>();
  const auto scene = buildGame();
  try {
    load(*scene, save(other));
    FAIL() << "no error";
  } catch (const EngineError& error) {
    EXPECT_STREQ(error.what(), "saved state: component 'Target' where this game has 'Spawner'");
  }
}

TEST(SaveLoad, TruncatedStatesAreRefused) {
  const auto scene = buildGame();
  play(*scene, 1, 4);
  const std::string state = save(*scene);
  for (std::size_t size = 0; size < state.size(); size += 7) {
    const auto fresh = buildGame();
    EXPECT_THROW(load(*fresh, state.substr(0, size)), EngineError) << size << " bytes";
  }
}

}  // namespace
}  // namespace sim2vr::scene

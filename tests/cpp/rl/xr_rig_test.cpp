// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/physics/world.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/rl/sound.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/frames.hpp"

namespace sim2vr::rl {
namespace {

class CountingEnv : public RLEnv {
 public:
  std::string_view typeName() const override { return "test.Env"; }
  void beginRound() override { calls += "begin "; }
  void declareLog() override {
    calls += "log ";
    logColumn("frames", [this] { return ++frames_; });
    logTerm("term", [] { return 0.25; });
  }
  double calculateReward() override {
    calls += "reward ";
    return 0.5;
  }
  bool isOver() const override { return frames_ == 2; }
  float timeFeature() const override { return 0.0F; }

  std::string calls;

 private:
  int frames_ = 0;
};

class XrRigTest : public ::testing::Test {
 protected:
  XrRigTest() : physics_(scene_), context_{scene_, session_, physics_, 0, nullptr, sounds_} {}

  void frame(std::int64_t time_ns, const xr::DeviceState& state) {
    session_.nextFrame(time_ns, xr::validated(state));
    scene_.runFrame(time_ns, [] {});
  }

  static xr::DeviceState someState() {
    xr::DeviceState state;
    state.head = xr::toXr(Pose{Vec3(0.5, 1.25, -0.5), Quat(0.8, 0.6, 0.0, 0.0)});
    state.hand(xr::Hand::right).active = true;
    state.hand(xr::Hand::right).grip =
        xr::toXr(Pose{Vec3(0.25, 1.0, 0.5), Quat(0.6, 0.0, 0.8, 0.0)});
    return state;
  }

  scene::Scene scene_;
  physics::PhysicsWorld physics_;
  xr::Session session_;
  SoundLog sounds_;
  GameContext context_;
};

TEST_F(XrRigTest, FollowsTheDevicesInTheAppsFrame) {
  const XrRig rig = buildXrRig(context_);
  frame(0, someState());
  ASSERT_EQ(scene_.find(kHeadCameraPath), rig.camera);
  EXPECT_TRUE(rig.camera->transform().position().isApprox(Vec3(0.5, 1.25, -0.5), 1e-7));
  EXPECT_TRUE(rig.camera->transform().rotation().isApprox(Quat(0.8, 0.6, 0.0, 0.0), 1e-6));
  EXPECT_TRUE(rig.right_controller->transform().position().isApprox(Vec3(0.25, 1.0, 0.5), 1e-7));
  EXPECT_TRUE(
      rig.right_controller->transform().rotation().isApprox(Quat(0.6, 0.0, 0.8, 0.0), 1e-6));
}

TEST_F(XrRigTest, SwitchesInactiveControllersOffAndOnAgain) {
  const XrRig rig = buildXrRig(context_);
  frame(0, someState());
  EXPECT_FALSE(rig.left_controller->activeInHierarchy());
  EXPECT_TRUE(rig.right_controller->activeInHierarchy());
  xr::DeviceState swapped = someState();
  swapped.hand(xr::Hand::left) = swapped.hand(xr::Hand::right);
  swapped.hand(xr::Hand::right).active = false;
  frame(50'000'000, swapped);
  EXPECT_TRUE(rig.left_controller->activeInHierarchy());
  EXPECT_FALSE(rig.right_controller->activeInHierarchy());
  EXPECT_TRUE(rig.right_controller->transform().position().isApprox(Vec3(0.25, 1.0, 0.5), 1e-7));
}

TEST_F(XrRigTest, SetsTheCamera) {
  XrRigSettings settings;
  settings.far_m = 3.0;
  const XrRig rig = buildXrRig(context_, settings);
  const auto* camera = rig.camera->getComponent<render::Camera>();
  ASSERT_NE(camera, nullptr);
  EXPECT_EQ(camera->vertical_fov_deg, 90.0);
  EXPECT_EQ(camera->far_m, 3.0);
}

TEST_F(XrRigTest, PutsAHeadsetWhereOnlyOthersSeeIt) {
  const XrRig rig = buildXrRig(context_);
  frame(0, someState());
  const scene::GameObject* headset = scene_.find("XR Rig/Main Camera/Headset");
  ASSERT_NE(headset, nullptr);
  EXPECT_TRUE(headset->transform().position().isApprox(Vec3(0.5, 1.25, -0.5), 1e-7));
  const auto* camera = rig.camera->getComponent<render::Camera>();
  int parts = 0;
  scene_.forEach<render::MeshRenderer>([&](const render::MeshRenderer& part) {
    EXPECT_EQ(part.gameObject().layer(), kPlayerLooksLayer);
    EXPECT_FALSE(camera->sees(part.gameObject().layer()));
    ++parts;
  });
  EXPECT_GT(parts, 0);
  EXPECT_TRUE(camera->sees(0));
}

TEST_F(XrRigTest, WorksAgainWithTheSameSession) {
  buildXrRig(context_);
  frame(0, someState());
  scene::Scene next;
  physics::PhysicsWorld physics(next);
  GameContext context{next, session_, physics, 0, nullptr, sounds_};
  const XrRig rig = buildXrRig(context);
  EXPECT_NE(next.find(kHeadCameraPath), nullptr);
  EXPECT_NE(rig.root, scene_.find("XR Rig"));
}

TEST_F(XrRigTest, RefusesASessionAttachedWithoutTheRig) {
  session_.createActionSet("other");
  session_.attachActionSets();
  try {
    buildXrRig(context_);
    FAIL();
  } catch (const StateError& error) {
    EXPECT_NE(std::string(error.what()).find("build the rig before attachActionSets"),
              std::string::npos);
  }
}

TEST_F(XrRigTest, EnvironmentIsSetUpOnceAndUpdatedPerFrame) {
  buildXrRig(context_);
  auto& env = scene_.create("Env").addComponent<CountingEnv>();
  EXPECT_EQ(env.executionOrder(), 5);
  frame(0, someState());
  EXPECT_FALSE(env.finished());
  frame(50'000'000, someState());
  EXPECT_EQ(env.calls, "begin reward log reward ");
  EXPECT_EQ(env.reward(), 0.5F);
  EXPECT_TRUE(env.finished());
}

// Two frames in the first user step, one in the second; a quarter in each frame.
TEST_F(XrRigTest, TermsAreSummedOverTheUserStepAndOverTheRound) {
  buildXrRig(context_);
  auto& env = scene_.create("Env").addComponent<CountingEnv>();
  env.beginStep(2);
  frame(0, someState());
  frame(25'000'000, someState());
  EXPECT_EQ(env.log(),
            (std::map<std::string, double>{{"frames", 2.0}, {"term", 0.5}, {"termSum", 0.5}}));
  env.beginStep(1);
  frame(50'000'000, someState());
  EXPECT_EQ(env.log(),
            (std::map<std::string, double>{{"frames", 3.0}, {"term", 0.25}, {"termSum", 0.75}}));
}

TEST_F(XrRigTest, TheLogGoesOnAfterALoad) {
  buildXrRig(context_);
  auto& env = scene_.create("Env").addComponent<CountingEnv>();
  frame(0, someState());
  Archive saved = Archive::saver();
  env.fields(saved);
  frame(50'000'000, someState());
  Archive loaded = Archive::loader(saved.bytes());
  env.fields(loaded);
  EXPECT_EQ(env.log().at("termSum"), 0.25);
  frame(100'000'000, someState());
  EXPECT_EQ(env.log().at("termSum"), 0.5);
  EXPECT_EQ(env.log().size(), 3U);
}

}  // namespace
}  // namespace sim2vr::rl

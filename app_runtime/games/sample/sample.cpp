// SPDX-License-Identifier: Apache-2.0
#include "sample.hpp"

#include "sim2vr/core/random.hpp"
#include "sim2vr/physics/collider.hpp"
#include "sim2vr/physics/world.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/rl/sound.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::sample {
namespace {

constexpr double kHand_m = 0.03;  // radius of what the right hand touches with

// What the player can do and feel besides moving: OpenXR's actions, each bound to an input or an
// output of a controller.
struct Controls {
  const xr::Action* skip = nullptr;
  const xr::Action* vibrate = nullptr;
};

Controls makeControls(xr::Session& xr) {
  xr::ActionSet& set = xr.createActionSet("play");
  xr::Action& skip = xr.createAction(set, "skip", XR_ACTION_TYPE_BOOLEAN_INPUT);
  xr.suggestBinding(skip, "/user/hand/right/input/trigger/value");
  xr::Action& vibrate = xr.createAction(set, "vibrate", XR_ACTION_TYPE_VIBRATION_OUTPUT);
  xr.suggestBinding(vibrate, "/user/hand/right/output/haptic");
  return {&skip, &vibrate};
}

// A component is a piece of behaviour on an object of the scene, with Unity's life cycle.
class Ball : public scene::Component {
 public:
  Ball(std::uint32_t seed, double radius_m, const scene::GameObject& hand, xr::Session& xr,
       const Controls& controls)
      : random_(seed),
        clear_m_(radius_m + kHand_m + kMargin_m),
        hand_(hand),
        xr_(xr),
        controls_(controls) {}

  // Names the type in saved states.
  std::string_view typeName() const override { return "sample.Ball"; }

  // Before the first frame.
  void Start() override { move(); }

  // In the fixed step in which something begins to touch the ball: it is heard and felt.
  void OnTriggerEnter(const scene::TriggerContact&) override {
    ++points_;
    gameObject().getComponent<rl::AudioSource>()->PlayOneShot("touch");
    xr_.applyHapticFeedback(*controls_.vibrate, std::nullopt, kPulse);
    move();
  }

  // In every frame. A pulled trigger moves the ball on, without a point.
  void Update() override {
    const xr::ActionState& skip = xr_.actionState(*controls_.skip);
    if (skip.changed && skip.pressed()) move();
  }

  // Every value that changes during play, so that a state can be saved and loaded.
  void fields(Archive& archive) override {
    archive.field("random", random_);
    archive.field("points", points_, kCounts);
  }

  int points() const { return points_; }

 private:
  // Somewhere in front of the player, where a right arm comes without leaning, and not in the hand:
  // what is touched already cannot begin to be. Metres; x right, y up, z forward, floor at 0.
  void move() {
    const Vec3 hand = hand_.transform().position();
    for (int draw = 0; draw < kDraws; ++draw) {
      const double x = random_.range(-0.05F, 0.4F);
      const double y = random_.range(0.85F, 1.15F);
      transform().setPosition({x, y, 0.45});
      if ((transform().position() - hand).norm() > clear_m_) return;
    }
  }

  static constexpr double kMargin_m = 0.05;  // the hand moves on
  static constexpr int kDraws = 100;

  // 20 ms at half strength, at the frequency that the controller likes best.
  static constexpr XrHapticVibration kPulse{XR_TYPE_HAPTIC_VIBRATION, nullptr, 20'000'000,
                                            XR_FREQUENCY_UNSPECIFIED, 0.5F};

  Random random_;  // the only source of chance: a seed fixes the round
  double clear_m_;
  const scene::GameObject& hand_;
  xr::Session& xr_;
  Controls controls_;
  int points_ = 0;
};

// Turns play into what a learner sees. Runs after the game's own components.
class BallEnv : public rl::RLEnv {
 public:
  BallEnv(const Ball& ball, const scene::GameObject& controller, double round_s)
      : ball_(ball), controller_(controller), round_s_(static_cast<float>(round_s)) {}

  std::string_view typeName() const override { return "sample.BallEnv"; }

  void beginRound() override { start_s_ = clock().time(); }

  void declareLog() override {
    logColumn("Points", [this] { return points_; });
    logColumn("Distance", [this] { return distance_sum_m_ / frames_; });
  }

  double calculateReward() override {
    const double distance_m =
        (ball_.transform().position() - controller_.transform().position()).norm();
    const int new_points = ball_.points() - points_;
    points_ = ball_.points();
    distance_sum_m_ += distance_m;
    ++frames_;
    return new_points - 0.1 * distance_m;
  }

  bool isOver() const override { return clock().time() - start_s_ >= round_s_; }

  float timeFeature() const override {
    return 2.0F * (clock().time() - start_s_) / round_s_ - 1.0F;
  }

  void fields(Archive& archive) override {
    RLEnv::fields(archive);
    archive.field("start_s", start_s_, kQuantities);
    archive.field("points", points_, kCounts);
    archive.field("distance_sum_m", distance_sum_m_, kQuantities);
    archive.field("frames", frames_, kCounts);
  }

 private:
  const Ball& ball_;
  const scene::GameObject& controller_;
  float round_s_;
  float start_s_ = 0.0F;
  int points_ = 0;
  double distance_sum_m_ = 0.0;
  int frames_ = 0;
};

}  // namespace

// What people see of the game: tables, learning curves, films and `--help` are made of it.
rl::GameFacts TouchTheBall::facts() const {
  rl::GameFacts facts;
  facts.round_seconds = 20.0;
  facts.devices = {"controller_right"};
  facts.measures = {
      {.name = "points", .label = "Points", .log_key = "Points"},
      {.name = "distance_m",
       .label = "Distance to the ball",
       .unit = "m",
       .log_key = "Distance",
       .better = rl::Better::kLower,
       .digits = 3,
       .description = "Between controller and ball, mean over the round"},
  };
  facts.score = "points";
  facts.conditions = {
      {.name = "big",
       .description = "Radius 10 cm",
       .options_json = R"({"ball_radius_m": 0.10})",
       .evaluated = true},
      {.name = "usual",
       .description = "Radius 5 cm",
       .options_json = R"({"ball_radius_m": 0.05})",
       .evaluated = true},
      {.name = "small",
       .description = "Radius 2.5 cm",
       .options_json = R"({"ball_radius_m": 0.025})",
       .evaluated = true},
  };
  facts.default_condition = "usual";
  return facts;
}

// Options come from the configuration; a misspelt name or a wrong type is reported to the user.
void TouchTheBall::configure(Options& options) {
  const double radius_m = options.getNumber("ball_radius_m", 0.05, 0.01, 0.2);
  const double round_s = options.getNumber("round_seconds", 20.0, 1.0, 600.0);
  ball_radius_m_ = radius_m;
  round_s_ = round_s;
}

// Called for every round with an empty scene.
rl::RLEnv& TouchTheBall::build(rl::GameContext& context) {
  scene::Scene& scene = context.scene;

  // Head camera and controllers, moved by the player. A game's own actions are made first.
  const Controls controls = makeControls(context.xr);
  const rl::XrRig rig = rl::buildXrRig(context);
  rig.right_controller->addComponent<physics::Collider>(physics::Sphere{kHand_m});

  // The ball: a shape that triggers, and a look. Sizes are in units of the object's scale.
  scene::GameObject& object = scene.create("Ball");
  object.transform().setLocalScale(ball_radius_m_);
  object.addComponent<physics::Rigidbody>();
  object.addComponent<physics::Collider>(physics::Sphere{1.0}, Vec3::Zero(), /*is_trigger=*/true);
  object.addComponent<render::MeshRenderer>(render::sphere(16)).material.albedo = {1.0F, 0.4F, 0.0F,
                                                                                   1.0F};
  object.addComponent<rl::AudioSource>(context.sounds);
  auto& ball = object.addComponent<Ball>(context.seed, ball_radius_m_, *rig.right_controller,
                                         context.xr, controls);

  scene::GameObject& light = scene.create("Light");
  light.transform().setLocalRotation(rotationBetween(Vec3::UnitZ(), Vec3(0.3, -1.0, 0.5)));
  light.addComponent<render::DirectionalLight>();
  scene.create("Sky").addComponent<render::Skybox>();

  return scene.create("RL Environment")
      .addComponent<BallEnv>(ball, *rig.right_controller, round_s_);
}

}  // namespace sim2vr::games::sample

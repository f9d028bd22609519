#include "sample/sample.hpp"

#include "sim2vr/core/random.hpp"
#include "sim2vr/physics/collider.hpp"
#include "sim2vr/physics/world.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::games::sample {
namespace {

// A component is a piece of behaviour on an object of the scene, with Unity's life cycle.
class Ball : public scene::Component {
 public:
  explicit Ball(std::uint32_t seed) : random_(seed) {}

  // Names the type in saved states.
  std::string_view typeName() const override { return "sample.Ball"; }

  // Before the first frame.
  void Start() override { move(); }

  // In the fixed step in which something begins to touch the ball.
  void OnTriggerEnter(const scene::TriggerContact&) override {
    ++points_;
    move();
  }

  // Every value that changes during play, so that a state can be saved and loaded.
  void fields(Archive& archive) override {
    archive.field("random", random_);
    archive.field("points", points_);
  }

  int points() const { return points_; }

 private:
  // Somewhere in front of the player. Metres; x right, y up, z forward, floor at 0.
  void move() {
    const double x = random_.range(-0.3F, 0.4F);
    const double y = random_.range(0.9F, 1.3F);
    transform().setPosition({x, y, 0.45});
  }

  Random random_;  // the only source of chance: a seed fixes the round
  int points_ = 0;
};

// Turns play into what a learner sees. Runs after the game's own components.
class BallEnv : public rl::RLEnv {
 public:
  BallEnv(const Ball& ball, const scene::GameObject& controller, double round_s)
      : ball_(ball), controller_(controller), round_s_(static_cast<float>(round_s)) {}

  std::string_view typeName() const override { return "sample.BallEnv"; }

  void InitialiseGame() override { start_s_ = clock().time(); }
  void InitialiseReward() override { log_["Points"] = points_; }

  void CalculateReward() override {
    const Vec3 to_ball = ball_.transform().position() - controller_.transform().position();
    const double shaping = -0.1 * to_ball.norm();
    reward_ = static_cast<float>(ball_.points() - points_ + shaping);
    points_ = ball_.points();
    log_["Points"] = points_;
  }

  void UpdateIsFinished() override { finished_ = clock().time() - start_s_ >= round_s_; }

  float GetTimeFeature() const override {
    return 2.0F * (clock().time() - start_s_) / round_s_ - 1.0F;
  }

  void fields(Archive& archive) override {
    RLEnv::fields(archive);
    archive.field("start_s", start_s_);
    archive.field("points", points_);
  }

 private:
  const Ball& ball_;
  const scene::GameObject& controller_;
  float round_s_;
  float start_s_ = 0.0F;
  int points_ = 0;
};

}  // namespace

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

  // Head camera and controllers, moved by the player.
  const rl::XrRig rig = rl::buildXrRig(context);
  rig.right_controller->addComponent<physics::Collider>(physics::Sphere{0.03});

  // The ball: a shape that triggers, and a look. Sizes are in units of the object's scale.
  scene::GameObject& object = scene.create("Ball");
  object.transform().setLocalScale(ball_radius_m_);
  object.addComponent<physics::Rigidbody>();
  object.addComponent<physics::Collider>(physics::Sphere{1.0}, Vec3::Zero(), /*is_trigger=*/true);
  object.addComponent<render::MeshRenderer>(render::sphere(16)).material.albedo = {1.0F, 0.4F, 0.0F,
                                                                                   1.0F};
  auto& ball = object.addComponent<Ball>(context.seed);

  scene::GameObject& light = scene.create("Light");
  light.transform().setLocalRotation(Quat::FromTwoVectors(Vec3::UnitZ(), Vec3(0.3, -1.0, 0.5)));
  light.addComponent<render::DirectionalLight>();
  scene.create("Sky").addComponent<render::Skybox>();

  return scene.create("RL Environment")
      .addComponent<BallEnv>(ball, *rig.right_controller, round_s_);
}

}  // namespace sim2vr::games::sample

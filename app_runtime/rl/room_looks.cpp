// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/rl/room_looks.hpp"

#include <algorithm>
#include <array>
#include <string>

#include "sim2vr/render/mesh.hpp"
#include "sim2vr/rl/xr_rig.hpp"

namespace sim2vr::rl {
namespace {

// From the head, in metres to its right, up and ahead.
const std::array<OutsideView, 2>& views() {
  static const std::array<OutsideView, 2> both{{
      {kThirdPersonCameraPath, {0.30, 0.45, -0.95}, {0.05, -0.20, 0.40}},
      {kSpectatorCameraPath, {0.95, 0.35, -0.60}, {0.0, -0.20, 0.30}},
  }};
  return both;
}

// The head's rotation about the vertical alone; straight ahead for one that looks up or down.
Quat heading(const Quat& head) {
  Vec3 ahead = head * Vec3::UnitZ();
  ahead.y() = 0.0;
  return ahead.norm() < 1e-3 ? Quat::Identity() : lookAlong(ahead);
}

// Puts the cameras up in the first frame, when the head has been tracked, and never again.
class OutsideCameras : public scene::Component {
 public:
  // After the rig and the game.
  static constexpr int kExecutionOrder = 10;

  explicit OutsideCameras(const scene::GameObject& head) : head_(head) {}

  std::string_view typeName() const override { return "OutsideCameras"; }
  int executionOrder() const override { return kExecutionOrder; }

  void add(scene::GameObject& camera, const OutsideView& view) {
    cameras_[count_] = &camera;
    views_[count_++] = &view;
  }

  void Update() override {
    if (placed_) return;
    placed_ = true;
    const Vec3 head_m = head_.transform().position();
    const Quat facing = heading(head_.transform().rotation());
    for (std::size_t i = 0; i < count_; ++i) {
      const OutsideView& view = *views_.at(i);
      cameras_.at(i)->transform().setPose(
          {head_m + facing * view.place_m, facing * lookAlong(view.towards_m - view.place_m)});
    }
  }

  void fields(Archive& archive) override { archive.field("placed", placed_); }

 private:
  const scene::GameObject& head_;
  std::array<scene::GameObject*, 2> cameras_{};
  std::array<const OutsideView*, 2> views_{};
  std::size_t count_ = 0;
  bool placed_ = false;
};

bool showsSomething(const scene::GameObject& object) {
  if (object.getComponent<render::MeshRenderer>() != nullptr) return true;
  return std::ranges::any_of(object.transform().children(), [](const scene::Transform* child) {
    return showsSomething(child->gameObject());
  });
}

// A grip with a ring on top, as big as a hand.
void addControllerLooks(scene::GameObject& controller) {
  scene::Scene& scene = controller.scene();
  const auto part = [&](const std::string& name, const render::MeshPtr& mesh,
                        const render::Color& color) -> scene::Transform& {
    scene::GameObject& object = scene.create(name, &controller);
    object.setLayer(kPlayerLooksLayer);
    render::Material material;
    material.albedo = color;
    object.addComponent<render::MeshRenderer>(mesh, material);
    return object.transform();
  };
  static const render::MeshPtr grip = render::capsule(0.018, 0.16, 12);
  static const render::MeshPtr ball = render::sphere(12);
  // The grip's axis lies along the hand's z, as OpenXR has it.
  part("Grip", grip, {0.20F, 0.21F, 0.23F, 1.0F})
      .setLocalRotation(rotationBetween(Vec3::UnitY(), Vec3::UnitZ()));
  scene::Transform& hand = part("Hand", ball, {0.75F, 0.74F, 0.72F, 1.0F});
  hand.setLocalScale({0.032, 0.036, 0.042});
}

constexpr render::Color kFloor{0.16F, 0.20F, 0.24F, 1.0F};
constexpr render::Color kBackground{0.04F, 0.06F, 0.09F, 1.0F};

}  // namespace

void addOutsideCameras(scene::Scene& scene) {
  scene::GameObject* head = scene.find(kHeadCameraPath);
  const auto missing = [&scene](const OutsideView& view) {
    return scene.find(view.path) == nullptr;
  };
  if (head == nullptr || !std::ranges::any_of(views(), missing)) return;
  auto& placing = scene.create("Outside Cameras").addComponent<OutsideCameras>(*head);
  for (const OutsideView& view : views()) {
    if (!missing(view)) continue;
    scene::GameObject& object = scene.create(std::string(view.path));
    auto& camera = object.addComponent<render::Camera>();
    camera.vertical_fov_deg = view.vertical_fov_deg;
    placing.add(object, view);
  }
  for (const std::string_view hand : {kLeftControllerPath, kRightControllerPath}) {
    scene::GameObject* controller = scene.find(hand);
    if (controller != nullptr && !showsSomething(*controller)) addControllerLooks(*controller);
  }
}

render::DirectionalLight& addLight(scene::Scene& scene, const Vec3& direction) {
  scene::GameObject& light = scene.create("Light");
  light.transform().setLocalRotation(lookAlong(direction));
  return light.addComponent<render::DirectionalLight>();
}

render::Camera& addCamera(scene::Scene& scene, const OutsideView& view) {
  auto& camera = scene.create(std::string(view.path)).addComponent<render::Camera>();
  camera.vertical_fov_deg = view.vertical_fov_deg;
  return camera;
}

void addDarkRoom(scene::Scene& scene, std::span<render::Camera* const> cameras, double radius_m,
                 const Vec3& light_direction) {
  for (render::Camera* camera : cameras) camera->background = kBackground;
  scene::GameObject& floor = scene.create("Floor");
  render::Material stone;
  stone.albedo = kFloor;
  stone.sky_reflections = false;
  stone.specular_highlights = false;
  floor.addComponent<render::MeshRenderer>(render::disc(24), stone);
  // Its front looks along -z.
  floor.transform().setLocalRotation(rotationBetween(-Vec3::UnitZ(), Vec3::UnitY()));
  floor.transform().setLocalScale({radius_m, radius_m, 1.0});
  addLight(scene, light_direction);
}

}  // namespace sim2vr::rl

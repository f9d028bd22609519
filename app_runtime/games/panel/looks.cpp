// SPDX-License-Identifier: Apache-2.0
#include "panel/looks.hpp"

#include <array>
#include <string>

#include "panel/widget.hpp"
#include "sim2vr/render/mesh.hpp"
#include "sim2vr/rl/room_looks.hpp"

namespace sim2vr::games::panel {
namespace {

using render::Color;

constexpr Color kRay{0.6F, 0.9F, 1.0F, 0.6F};
constexpr Color kCursor{1.0F, 1.0F, 1.0F, 0.95F};
constexpr Color kHand{0.30F, 0.32F, 0.36F, 1.0F};
constexpr Color kFingertip{0.10F, 0.90F, 0.90F, 1.0F};

constexpr double kRayRadius_m = 0.003;
constexpr double kCursor_m = 0.03;  // at 1.5 m
constexpr int kCursorLayer = 5;
constexpr double kMargin_m = 0.1;

// From the head, towards the middle of head and panel.
const std::array<rl::OutsideView, 2>& views() {
  static const std::array<rl::OutsideView, 2> both{{
      {rl::kThirdPersonCameraPath, {-0.45, 0.35, -0.75}, {}, 55.0},
      {rl::kSpectatorCameraPath, {1.0, 0.30, -0.30}, {}, 55.0},
  }};
  return both;
}

}  // namespace

void addRoomLooks(scene::Scene& scene, const rl::XrRig& rig, Select select) {
  const std::array cameras{rig.camera->getComponent<render::Camera>(),
                           &rl::addCamera(scene, views().front()),
                           &rl::addCamera(scene, views().back())};
  for (scene::GameObject* controller : {rig.left_controller, rig.right_controller}) {
    auto& body = addShape(*controller, "Controller", render::box(), Vec3::Zero(),
                          {0.03, 0.03, 0.10}, kHand, 0);
    body.material.unlit = false;
    if (select != Select::touch) continue;
    auto& finger = addShape(*controller, "Finger", render::box(), {0.0, 0.0, kFinger_m / 2.0},
                            {0.012, 0.012, kFinger_m - 0.012}, kHand, 0);
    finger.material.unlit = false;
    addShape(*controller, "Fingertip", render::sphere(8), {0.0, 0.0, kFinger_m - 0.008},
             Vec3::Constant(0.008), kFingertip, 0);
  }
  rl::addDarkRoom(scene, cameras, 2.0, {-0.3, -1.0, 0.5});
}

void placeCameras(scene::Scene& scene, const Vec3& head_m, const Vec3& panel_m) {
  for (rl::OutsideView view : views()) {
    view.towards_m = 0.4 * (panel_m - head_m) - Vec3(0.0, 0.15, 0.0);
    scene.find(view.path)->transform().setPose(view.from(head_m));
  }
}

void Looks::Awake() {
  Vec3 most_m = Vec3::Zero();
  for (const auto& widget : round_.widgets()) {
    most_m = most_m.cwiseMax(widget->center_m().cwiseAbs());
  }
  const double margin_m = round_.settings().widgets == Widgets::buttons
                              ? round_.settings().pitch_m
                              : 0.4 * round_.settings().scale() + kMargin_m;
  addShape(gameObject(), "Plate", render::quad(), Vec3::Zero(),
           {2.0 * (most_m.x() + margin_m), 2.0 * (most_m.y() + margin_m), 1.0}, kPlate, 0);
  for (std::size_t i = 0; i < round_.pointers().size(); ++i) {
    rays_.push_back(
        &addShape(gameObject(), "Ray", render::cylinder(6), Vec3::Zero(), Vec3::Ones(), kRay, 0));
    cursors_.push_back(&addShape(gameObject(), "Cursor", render::disc(12), Vec3::Zero(),
                                 Vec3::Ones(), kCursor, kCursorLayer));
    rays_.back()->visible = cursors_.back()->visible = false;
  }
}

void Looks::LateUpdate() {
  const auto& widgets = round_.widgets();
  for (std::size_t i = 0; i < widgets.size(); ++i) {
    widgets[i]->show(!round_.over() && static_cast<int>(i) == round_.lit());
  }
  const double cursor_m = kCursor_m * round_.settings().scale() / 2.0;
  for (std::size_t i = 0; i < rays_.size(); ++i) {
    const PointerState& state = round_.pointers()[i].state();
    cursors_[i]->visible = state.active && state.on_plane;
    moveShape(*cursors_[i], state.place_m);
    cursors_[i]->transform().setLocalScale({cursor_m, cursor_m, 1.0});
    const Round::Flash flash = round_.flash();
    cursors_[i]->material.albedo = flash == Round::Flash::hit     ? kHit
                                   : flash == Round::Flash::error ? kError
                                                                  : kCursor;
    rays_[i]->visible = cursors_[i]->visible && round_.settings().select == Select::ray;
    if (!rays_[i]->visible) continue;
    const Vec3 end_m = round_.center_m() + state.place_m;
    const Vec3 way = end_m - state.origin_m;
    rays_[i]->transform().setPose(
        {state.origin_m + way / 2.0, rotationBetween(Vec3::UnitY(), way)});
    rays_[i]->transform().setLocalScale({kRayRadius_m, way.norm(), kRayRadius_m});
  }
}

}  // namespace sim2vr::games::panel

// SPDX-License-Identifier: Apache-2.0
#include "pointing/looks.hpp"

#include <algorithm>
#include <array>
#include <string>

#include "sim2vr/render/mesh.hpp"
#include "sim2vr/rl/room_looks.hpp"
#include "sim2vr/rl/xr_rig.hpp"

namespace sim2vr::games::pointing {
namespace {

using render::Color;

constexpr Color kTarget{1.0F, 0.15F, 0.10F, 1.0F};
// Until the tip has come out of the plane.
constexpr Color kWaiting{0.55F, 0.08F, 0.06F, 1.0F};
constexpr Color kPlace{0.12F, 0.35F, 0.55F, 1.0F};
constexpr Color kHit{0.10F, 0.85F, 0.30F, 1.0F};
constexpr Color kError{0.15F, 0.25F, 1.0F, 1.0F};
constexpr Color kSheet{0.10F, 0.45F, 0.60F, 0.12F};
constexpr Color kPen{0.30F, 0.32F, 0.36F, 1.0F};
constexpr Color kTip{0.10F, 0.90F, 0.90F, 1.0F};

// Behind one another, so that none flickers: the target in front, in the plane itself.
constexpr double kFlash_z_m = 0.0005;
constexpr double kRing_z_m = 0.001;
constexpr double kSheet_z_m = 0.002;
constexpr double kSheetMargin_m = 0.05;

constexpr double kPenRadius_m = 0.005;
constexpr double kTipRadius_m = 0.007;
constexpr double kPenBack_m = 0.06;

render::Material glow(const Color& color) {
  render::Material material = render::unlitMaterial(color);
  material.cull_back = false;
  return material;
}

render::MeshRenderer& addShape(scene::GameObject& parent, const std::string& name,
                               const render::MeshPtr& mesh, const render::Material& material) {
  scene::GameObject& shape = parent.scene().create(name, &parent);
  return shape.addComponent<render::MeshRenderer>(mesh, material);
}

void place(render::MeshRenderer& shape, const Vec3& center_m, double diameter_m, double behind_m) {
  shape.visible = true;
  shape.transform().setPosition(center_m + Vec3(0.0, 0.0, behind_m));
  shape.transform().setLocalScale({diameter_m / 2.0, diameter_m / 2.0, 1.0});
}

// From the head of a right-handed player.
const std::array<rl::OutsideView, 2>& views() {
  static const std::array<rl::OutsideView, 2> both{{
      {rl::kThirdPersonCameraPath, {-0.25, 0.30, -0.60}, {0.12, -0.10, 0.40}, 50.0},
      {rl::kSpectatorCameraPath, {0.80, 0.25, -0.35}, {0.08, -0.12, 0.25}, 50.0},
  }};
  return both;
}

}  // namespace

void addStylusLooks(scene::GameObject& controller, double length_m) {
  render::Material paint;
  paint.albedo = kPen;
  const double length_of_pen_m = kPenBack_m + length_m - kTipRadius_m;
  // Made around y, shown around z.
  const Quat along_z = rotationBetween(Vec3::UnitY(), Vec3::UnitZ());
  auto& pen = addShape(controller, "Pen", render::cylinder(8), paint);
  pen.transform().setLocalRotation(along_z);
  pen.transform().setLocalPosition({0.0, 0.0, length_of_pen_m / 2.0 - kPenBack_m});
  pen.transform().setLocalScale({kPenRadius_m, length_of_pen_m, kPenRadius_m});
  auto& tip = addShape(controller, "Tip", render::sphere(8), glow(kTip));
  tip.transform().setLocalPosition({0.0, 0.0, length_m - kTipRadius_m});
  tip.transform().setLocalScale(kTipRadius_m);
}

void addRoomLooks(scene::Scene& scene, scene::GameObject& head_camera, xr::Hand hand) {
  render::Camera& third_person = rl::addCamera(scene, views().front());
  render::Camera& spectator = rl::addCamera(scene, views().back());
  // It looks over the player's shoulder.
  third_person.culling_mask = ~(1U << rl::kPlayerLooksLayer);
  // Lit from the other side for a left hand, so that its picture is the mirror image.
  const double side = hand == xr::Hand::left ? -1.0 : 1.0;
  const std::array cameras{head_camera.getComponent<render::Camera>(), &third_person, &spectator};
  rl::addDarkRoom(scene, cameras, 1.5, {side * -0.3, -1.0, 0.5});
}

void placeCameras(scene::Scene& scene, const Vec3& head_m, xr::Hand hand) {
  const Vec3 side(hand == xr::Hand::left ? -1.0 : 1.0, 1.0, 1.0);
  for (rl::OutsideView view : views()) {
    view.place_m = view.place_m.cwiseProduct(side);
    view.towards_m = view.towards_m.cwiseProduct(side);
    scene.find(view.path)->transform().setPose(view.from(head_m));
  }
}

void Board::Awake() {
  sheet_ = &addShape(gameObject(), "Sheet", render::quad(), glow(kSheet));
  for (int i = 0; i < round_.settings().targets; ++i) {
    rings_.push_back(&addShape(gameObject(), "Place", render::annulus(0.8, 1.0, 16), glow(kPlace)));
  }
  flash_ = &addShape(gameObject(), "Flash", render::disc(16), glow(kHit));
  disc_ = &addShape(gameObject(), "Target", render::disc(16), glow(kTarget));
  sheet_->visible = flash_->visible = disc_->visible = false;
  for (render::MeshRenderer* ring : rings_) ring->visible = false;
}

void Board::LateUpdate() {
  if (round_.phase() == Round::Phase::kReady) return;
  const Block& block = round_.block();
  const double side_m = block.distance_m + block.width_m + 2.0 * kSheetMargin_m;
  // A quad is 1 m wide, a disc 2 m.
  place(*sheet_, round_.center_m(), 2.0 * side_m, kSheet_z_m);
  const bool up = round_.phase() == Round::Phase::kPlay;
  for (std::size_t i = 0; i < rings_.size(); ++i) {
    const int target = static_cast<int>(i);
    place(*rings_[i], round_.targetCenter(target), block.width_m, kRing_z_m);
    rings_[i]->visible = !up || target != round_.target();
  }
  place(*disc_, round_.targetCenter(round_.target()), block.width_m, 0.0);
  disc_->visible = up;
  disc_->material.albedo = round_.stylus().armed() ? kTarget : kWaiting;
  const Outcome outcome = round_.lastOutcome();
  const bool known = outcome == Outcome::kHit || outcome == Outcome::kError;
  flash_->visible = known && clock().time() - round_.lastOutcome_s() < kFlash_s;
  if (!flash_->visible) return;
  place(*flash_, round_.lastCenter_m(), round_.lastWidth_m(), kFlash_z_m);
  flash_->material.albedo = outcome == Outcome::kHit ? kHit : kError;
}

}  // namespace sim2vr::games::pointing

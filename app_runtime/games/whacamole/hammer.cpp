// SPDX-License-Identifier: Apache-2.0
#include "whacamole/hammer.hpp"

#include "sim2vr/physics/collider.hpp"
#include "sim2vr/scene/scene.hpp"
#include "whacamole/layers.hpp"
#include "whacamole/looks.hpp"

namespace sim2vr::games::whacamole {
namespace {

constexpr double kScale = 0.1;

// In the right controller's frame (docs/reference/games/whacamole.md, "Hammer").
const Vec3 kPosition_m(0.0096, -0.0491, -0.0545);
const Quat kRotation = Quat(0.63740873, 0.30295587, 0.6412905, 0.301122).normalized();

// In hammer units (a tenth of a metre).
const Vec3 kMarker(-0.482, 1.385, -0.005);
const Vec3 kHeadSize(1.0, 0.55, 0.55);
const Vec3 kHeadCenter(-0.004010893, 1.3975825, -0.008178129);

// A left hand's hammer is the mirror image, x turned round in the controller's frame. Its own frame
// is mirrored along z, so that the striking face still looks along -x and the handle along y.
Vec3 ofHand(xr::Hand hand, const Vec3& in_hammer) {
  return hand == xr::Hand::left ? Vec3(in_hammer.x(), in_hammer.y(), -in_hammer.z()) : in_hammer;
}

Pose mount(xr::Hand hand) {
  if (hand == xr::Hand::right) return {kPosition_m, kRotation};
  // With reflections X and Z of those axes X R Z = (X R X)(X Z), and X Z is half a turn about y.
  const Quat mirrored(kRotation.w(), kRotation.x(), -kRotation.y(), -kRotation.z());
  return {Vec3(-kPosition_m.x(), kPosition_m.y(), kPosition_m.z()),
          mirrored * Quat(0.0, 0.0, 1.0, 0.0)};
}

}  // namespace

void Hammer::Update() {
  const Vec3 position = measuredPoint();
  const double dt = clock().deltaTime();
  if (has_position_ && dt > 0.0) {
    velocity_ += smoothing_ * ((position - last_position_) / dt - velocity_);
  }
  last_position_ = position;
  has_position_ = true;
}

Vec3 Hammer::measuredPoint() const {
  return point_ == VelocityPoint::kRoot ? transform().position()
                                        : transform().transformPoint(ofHand(hand_, kHeadCenter));
}

void Hammer::fields(Archive& archive) {
  archive.field("velocity", velocity_);
  archive.field("last_position", last_position_);
  archive.field("has_position", has_position_);
}

Hammer& buildHammer(scene::GameObject& controller, const Settings& settings) {
  scene::Scene& scene = controller.scene();
  scene::GameObject& object = scene.create("Hammer", &controller);
  object.setLayer(kPlayerLayer);
  const Pose held = mount(settings.hand);
  object.transform().setLocalPosition(held.position);
  object.transform().setLocalRotation(held.rotation);
  object.transform().setLocalScale(kScale);
  auto& hammer = object.addComponent<Hammer>(settings);
  const Vec3 margin = Vec3::Constant(2.0 * settings.hammer_margin_m / kScale);
  object.addComponent<physics::Collider>(physics::Box{kHeadSize + margin},
                                         ofHand(settings.hand, kHeadCenter), /*is_trigger=*/false);
  scene::GameObject& marker = scene.create("Marker", &object);
  marker.transform().setLocalPosition(ofHand(settings.hand, kMarker));
  hammer.setMarker(marker);
  addHammerLooks(object);
  return hammer;
}

}  // namespace sim2vr::games::whacamole

#include "whacamole/hammer.hpp"

#include "sim2vr/physics/collider.hpp"
#include "sim2vr/scene/scene.hpp"
#include "whacamole/layers.hpp"
#include "whacamole/looks.hpp"

namespace sim2vr::games::whacamole {
namespace {

constexpr double kScale = 0.1;

// In the right controller's frame (docs/games/whacamole.md, "Hammer").
const Vec3 kPosition_m(0.0096, -0.0491, -0.0545);
const Quat kRotation = Quat(0.63740873, 0.30295587, 0.6412905, 0.301122).normalized();

// In hammer units (a tenth of a metre).
const Vec3 kMarker(-0.482, 1.385, -0.005);
const Vec3 kHeadSize(1.0, 0.55, 0.55);
const Vec3 kHeadCenter(-0.004010893, 1.3975825, -0.008178129);

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
                                        : transform().transformPoint(kHeadCenter);
}

void Hammer::fields(Archive& archive) {
  archive.field("velocity", velocity_);
  archive.field("last_position", last_position_);
  archive.field("has_position", has_position_);
}

Hammer& buildHammer(scene::GameObject& right_controller, const Settings& settings) {
  scene::Scene& scene = right_controller.scene();
  scene::GameObject& object = scene.create("Hammer", &right_controller);
  object.setLayer(kPlayerLayer);
  object.transform().setLocalPosition(kPosition_m);
  object.transform().setLocalRotation(kRotation);
  object.transform().setLocalScale(kScale);
  auto& hammer = object.addComponent<Hammer>(settings);
  const Vec3 margin = Vec3::Constant(2.0 * settings.hammer_margin_m / kScale);
  object.addComponent<physics::Collider>(physics::Box{kHeadSize + margin}, kHeadCenter,
                                         /*is_trigger=*/false);
  scene::GameObject& marker = scene.create("Marker", &object);
  marker.transform().setLocalPosition(kMarker);
  hammer.setMarker(marker);
  addHammerLooks(object);
  return hammer;
}

}  // namespace sim2vr::games::whacamole

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/rl/xr_rig.hpp"

#include <array>
#include <numbers>
#include <string>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/render/mesh.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/frames.hpp"

namespace sim2vr::rl {
namespace {

using render::Color;
using render::LathePoint;
using render::MeshPtr;

constexpr Color kShell{0.20F, 0.21F, 0.23F, 1.0F};
constexpr Color kFoam{0.08F, 0.08F, 0.09F, 1.0F};
constexpr Color kSkin{0.75F, 0.74F, 0.72F, 1.0F};

// Around y, which becomes the direction of view; radius 1 until it is scaled to an oval.
MeshPtr visorMesh() {
  static const std::array<LathePoint, 4> outline{
      {{0.94, -0.045}, {1.0, -0.015}, {0.96, 0.040}, {0.0, 0.047}}};
  static const MeshPtr mesh = render::lathe(outline, 20, "headset visor");
  return mesh;
}

// A level band of radius 1.
MeshPtr strapMesh() {
  static const std::array<LathePoint, 2> outline{{{1.0, -0.016}, {1.0, 0.016}}};
  static const MeshPtr mesh = render::lathe(outline, 20, "headset strap");
  return mesh;
}

scene::GameObject& addPart(scene::GameObject& parent, const std::string& name, int layer,
                           const MeshPtr& mesh, const Color& color) {
  scene::GameObject& part = parent.scene().create(name, &parent);
  part.setLayer(layer);
  render::Material material;
  material.albedo = color;
  part.addComponent<render::MeshRenderer>(mesh, material);
  return part;
}

/// Adds the looks below the head camera, all of them on `layer`. The camera's origin is between the
/// eyes; it must not see the layer, as it is inside.
void addHeadsetLooks(scene::GameObject& head_camera, int layer) {
  scene::GameObject& headset = head_camera.scene().create("Headset", &head_camera);
  headset.setLayer(layer);
  scene::GameObject& head = addPart(headset, "Head", layer, render::sphere(20), kSkin);
  head.transform().setLocalPosition({0.0, -0.015, -0.09});
  head.transform().setLocalScale({0.078, 0.113, 0.1});
  scene::GameObject& visor = addPart(headset, "Visor", layer, visorMesh(), kShell);
  visor.transform().setLocalRotation(
      Quat(Eigen::AngleAxisd(std::numbers::pi / 2.0, Vec3::UnitX())));
  visor.transform().setLocalScale({0.092, 1.0, 0.058});
  scene::GameObject& strap = addPart(headset, "Strap", layer, strapMesh(), kFoam);
  strap.transform().setLocalPosition({0.0, 0.01, -0.09});
  strap.transform().setLocalScale({0.081, 1.0, 0.103});
}

const xr::Action& gripAction(xr::Session& session) {
  if (session.attached()) {
    const xr::Action* grip = session.findAction(kRigActionSet, kGripAction);
    if (grip == nullptr) {
      throw StateError(
          "buildXrRig: the session's action sets are attached without the rig's; build the rig "
          "before attachActionSets or make a new session");
    }
    return *grip;
  }
  xr::ActionSet& set = session.createActionSet(std::string(kRigActionSet));
  xr::Action& grip = session.createAction(set, std::string(kGripAction), XR_ACTION_TYPE_POSE_INPUT);
  session.suggestBinding(grip, "/user/hand/left/input/grip/pose");
  session.suggestBinding(grip, "/user/hand/right/input/grip/pose");
  session.attachActionSets();
  return grip;
}

scene::GameObject& addTracked(XrRig& rig, const std::string& name, xr::Session& session,
                              const xr::Space& space) {
  scene::GameObject& object = rig.root->scene().create(name, rig.root);
  rig.root->addComponent<TrackedPoseDriver>(session, space, object);
  return object;
}

}  // namespace

void TrackedPoseDriver::Update() {
  const std::optional<XrPosef> pose = session_.locateSpace(space_);
  moved_.setActive(pose.has_value());
  if (pose) moved_.transform().setPose(xr::fromXr(*pose));
}

XrRig buildXrRig(GameContext& context, const XrRigSettings& settings) {
  xr::Session& session = context.xr;
  const xr::Action& grip = gripAction(session);
  XrRig rig;
  rig.root = &context.scene.create("XR Rig");
  rig.camera =
      &addTracked(rig, "Main Camera", session, {.reference = XR_REFERENCE_SPACE_TYPE_VIEW});
  rig.left_controller =
      &addTracked(rig, "LeftHand Controller", session, session.actionSpace(grip, xr::Hand::left));
  rig.right_controller =
      &addTracked(rig, "RightHand Controller", session, session.actionSpace(grip, xr::Hand::right));
  auto& camera = rig.camera->addComponent<render::Camera>();
  camera.vertical_fov_deg = session.settings().vertical_fov_deg;
  camera.near_m = settings.near_m;
  camera.far_m = settings.far_m;
  camera.culling_mask = ~(1U << kPlayerLooksLayer);
  addHeadsetLooks(*rig.camera, kPlayerLooksLayer);
  return rig;
}

}  // namespace sim2vr::rl

#include "sim2vr/rl/xr_rig.hpp"

#include <string>

#include "headset_looks.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/frames.hpp"

namespace sim2vr::rl {
namespace {

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

#include "beats/room_looks.hpp"

#include <array>
#include <string>

#include "beats/colors.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/render/mesh.hpp"
#include "sim2vr/rl/room_looks.hpp"
#include "sim2vr/rl/xr_rig.hpp"

namespace sim2vr::games::beats {
namespace {

// At 90 degrees the rails come into a picture of 3:2 in its lower corners (x / y = 3 / 2) and end
// two fifths of its height up.
constexpr double kRail_x_m = 1.2;
constexpr double kRail_y_m = -0.8;
constexpr double kRailWidth_m = 0.03;
constexpr double kRailFrom_m = -1.0;
constexpr double kRailTo_m = 5.0;

// From the origin. The third person's stands behind the player, the spectator's to the right.
const std::array<rl::OutsideView, 2>& views() {
  static const std::array<rl::OutsideView, 2> both{{
      {rl::kThirdPersonCameraPath, {0.0, 0.55, -1.7}, {0.0, -0.35, 1.5}, 60.0},
      {rl::kSpectatorCameraPath, {1.9, 0.55, -1.3}, {-0.1, -0.35, 1.0}, 55.0},
  }};
  return both;
}

}  // namespace

scene::GameObject& addRoomLooks(scene::Scene& scene) {
  scene::GameObject& lane = scene.create("Lane");
  for (const double side : {-1.0, 1.0}) {
    scene::GameObject& rail = scene.create(side < 0.0 ? "Left Rail" : "Right Rail", &lane);
    rail.addComponent<render::MeshRenderer>(render::box(), render::unlitMaterial(kRail));
    rail.transform().setLocalPosition(
        {side * kRail_x_m, kRail_y_m, (kRailFrom_m + kRailTo_m) / 2.0});
    rail.transform().setLocalScale({kRailWidth_m, kRailWidth_m, kRailTo_m - kRailFrom_m});
  }
  for (const rl::OutsideView& view : views()) rl::addCamera(scene, view).far_m = 20.0;
  rl::addLight(scene, {-0.4, -0.6, 0.7});
  return lane;
}

void placeRoom(scene::GameObject& lane, const Vec3& origin_m) {
  lane.transform().setPosition(origin_m);
  for (const rl::OutsideView& view : views()) {
    lane.scene().find(view.path)->transform().setPose(view.from(origin_m));
  }
}

}  // namespace sim2vr::games::beats

// What a round writes to the episode's log (docs/reference/games/panel.md, "Logs").
#include <fmt/format.h>

#include <array>
#include <string>
#include <vector>

#include "panel/round.hpp"

namespace sim2vr::games::panel {
namespace {

std::string inPlane(const Vec3& place_m) {
  return rl::formatFloat(place_m.x()) + " " + rl::formatFloat(place_m.y());
}

}  // namespace

void Round::openLog() {
  if (setup_.logger == nullptr) return;
  static const std::vector<std::string> kPoses{"left", "right", "head"};
  setup_.logger->beginRound("panel", setup_.seed, kPoses);
  setup_.logger->event(now_s_, "panel transform " + rl::formatPose({center_m_, Quat::Identity()}));
}

void Round::logState() {
  if (setup_.logger == nullptr) return;
  const auto pose_of = [](const scene::GameObject& controller) {
    return controller.activeInHierarchy() ? controller.transform().pose() : Pose{};
  };
  const std::array<Pose, 3> poses{pose_of(*setup_.rig.left_controller),
                                  pose_of(*setup_.rig.right_controller),
                                  setup_.rig.camera->transform().pose()};
  setup_.logger->state(now_s_, poses);
}

void Round::logTarget() {
  if (setup_.logger == nullptr) return;
  const Widget& widget = *widgets_[static_cast<std::size_t>(lit_)];
  setup_.logger->event(
      now_s_, fmt::format("target_spawn, target ID {}, grid ID {}, kind {}, center {}, width {}",
                          target_id_, lit_, widget.kind(), inPlane(widget.handle_m()),
                          rl::formatFloat(widget.width_m())));
}

void Round::logOutcome(const char* event, const Vec3* place_m) {
  if (setup_.logger == nullptr) return;
  std::string text = fmt::format("{}, target ID {}, grid ID {}, age {}", event, target_id_, lit_,
                                 rl::formatFloat(static_cast<double>(now_s_ - appeared_s_)));
  if (place_m != nullptr) text += ", place " + inPlane(*place_m);
  setup_.logger->event(now_s_, text);
}

}  // namespace sim2vr::games::panel

// What a round writes to the episode's log (docs/reference/games/pointing.md, "Logs").
#include <fmt/format.h>

#include <array>
#include <string>
#include <vector>

#include "pointing/round.hpp"

namespace sim2vr::games::pointing {
namespace {

/// "x y" from the circle's centre.
std::string inPlane(const Vec3& place_m, const Vec3& center_m) {
  const Vec3 from_center = place_m - center_m;
  return rl::formatFloat(from_center.x()) + " " + rl::formatFloat(from_center.y());
}

}  // namespace

void Round::openLog() {
  if (setup_.logger == nullptr) return;
  static const std::vector<std::string> kPoses{"left", "right", "head", "tip"};
  setup_.logger->beginRound("pointing", setup_.seed, kPoses);
  logState();
  const float now_s = clock().time();
  const std::string options = settings().playOptionsJson();
  if (options != "{}") setup_.logger->event(now_s, "game options " + options);
  setup_.logger->event(now_s,
                       "target plane transform " + rl::formatPose({center_m_, Quat::Identity()}));
}

void Round::logState() {
  if (setup_.logger == nullptr) return;
  const auto pose_of = [](const scene::GameObject& controller) {
    return controller.activeInHierarchy() ? controller.transform().pose() : Pose{};
  };
  const std::array<Pose, 4> poses{pose_of(*setup_.rig.left_controller),
                                  pose_of(*setup_.rig.right_controller),
                                  setup_.rig.camera->transform().pose(), setup_.stylus.tipPose()};
  setup_.logger->state(clock().time(), poses);
}

void Round::logBlock() {
  if (setup_.logger == nullptr) return;
  setup_.logger->event(
      clock().time(),
      fmt::format("block_start, block {}, distance {}, width {}, index {}, targets {}", block_,
                  rl::formatFloat(block().distance_m), rl::formatFloat(block().width_m),
                  rl::formatFloat(block().index_bits()), settings().targets));
}

void Round::logTarget() {
  if (setup_.logger == nullptr) return;
  setup_.logger->event(clock().time(),
                       fmt::format("target_spawn, target ID {}, grid ID {}, block {}, trial {}, "
                                   "center {}",
                                   target_id_, target(), block_, trial_,
                                   inPlane(targetCenter(target()), center_m_)));
}

void Round::logSelection(bool hit, const Crossing& crossing,
                         const std::optional<Movement>& movement) {
  if (setup_.logger == nullptr) return;
  std::string text = fmt::format("{}, target ID {}, grid ID {}, block {}, trial {}, place {}",
                                 hit ? "target_hit" : "target_error", target_id_, target(), block_,
                                 trial_, inPlane(crossing.place_m, center_m_));
  if (movement) {
    text +=
        fmt::format(", movement time {}, offset {}, length {}", rl::formatFloat(movement->time_s),
                    rl::formatFloat(movement->offset_m), rl::formatFloat(movement->length_m));
  }
  setup_.logger->event(crossing.time_s, text);
}

void Round::logTimeout() {
  if (setup_.logger == nullptr) return;
  setup_.logger->event(clock().time(),
                       fmt::format("target_miss, target ID {}, grid ID {}, block {}, trial {}",
                                   target_id_, target(), block_, trial_));
}

void Round::logBlockEnd(const std::optional<Effective>& effective) {
  if (setup_.logger == nullptr) return;
  std::string text = fmt::format("block_end, block {}, movements {}", block_, sums_.count());
  if (effective) {
    text += fmt::format(
        ", movement time {}, effective distance {}, effective width {}, effective index {}, "
        "throughput {}",
        rl::formatFloat(effective->movement_time_s), rl::formatFloat(effective->distance_m),
        rl::formatFloat(effective->width_m()), rl::formatFloat(effective->index_bits()),
        rl::formatFloat(effective->throughput_bps()));
  }
  setup_.logger->event(clock().time(), text);
}

void Round::closeLog() {
  if (setup_.logger == nullptr) return;
  setup_.logger->event(clock().time(),
                       fmt::format("episode statistics, hits {}, errors {}, timeouts {}",
                                   tally_.hits, tally_.errors, tally_.timeouts));
  setup_.logger->endRound();
}

}  // namespace sim2vr::games::pointing

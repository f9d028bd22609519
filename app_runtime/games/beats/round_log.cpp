// What a round writes to the episode's log.
#include <fmt/format.h>

#include <array>
#include <string>
#include <vector>

#include "beats/round.hpp"
#include "beats/round_event.hpp"

namespace sim2vr::games::beats {

void Round::openLog() {
  if (setup_.logger == nullptr) return;
  static const std::vector<std::string> kPoses{"left", "right", "head"};
  setup_.logger->beginRound(level().name, setup_.seed, kPoses);
  logState();
  setup_.logger->event(
      clock().time(),
      fmt::format("level {}, hash {}, boxes {}, mines {}, walls {}", level().name, level().hash,
                  level().boxes.size(), level().mines.size(), level().walls.size()));
  setup_.logger->event(clock().time(), "origin " + rl::formatVector(origin_m_));
}

void Round::logState() {
  if (setup_.logger == nullptr) return;
  const auto pose_of = [this](Hand hand) {
    return saber(hand).held() ? saber(hand).pose() : Pose{};
  };
  const std::array<Pose, 3> poses{pose_of(Hand::kLeft), pose_of(Hand::kRight), head_};
  setup_.logger->state(clock().time(), poses);
}

void Round::logEvent(const Event& event, const char* what) {
  if (setup_.logger == nullptr) return;
  std::string text = fmt::format("{}, number {}, level time {}, place {}", what, event.index,
                                 rl::formatFloat(event.time_s), rl::formatVector(event.place_m));
  if (event.touch) {
    text += fmt::format(", {}, velocity {}", event.touch->hand == Hand::kLeft ? "left" : "right",
                        rl::formatVector(event.touch->velocity_mps));
  }
  setup_.logger->event(clock().time(), text);
}

void Round::closeLog() {
  if (setup_.logger == nullptr) return;
  const Tally& tally = tally_;
  setup_.logger->event(
      clock().time(),
      fmt::format("episode statistics, score {}, slices {}, errors {}, misses {}", tally.score(),
                  tally.slices(), rl::formatFloat(tally.errors()), tally.misses()));
  setup_.logger->endRound();
}

}  // namespace sim2vr::games::beats

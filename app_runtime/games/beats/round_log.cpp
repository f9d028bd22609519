// What a round writes to the episode's log.
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "beats/directions.hpp"
#include "beats/round.hpp"
#include "beats/round_event.hpp"

namespace sim2vr::games::beats {
namespace {

/// What a box asks for: the hand and, as the player sees it, the angle of the way through it, from
/// the right counter-clockwise; no angle where any way will do.
std::string demand(const Box& box) {
  std::string text = fmt::format("kind: {} {}", box.hand == Hand::kLeft ? "left" : "right",
                                 box.link ? "link" : "box");
  const Eigen::Vector2d way = cutVector(box);
  if (way.isZero()) return text;
  const double angle_deg = std::atan2(way.y(), way.x()) * 180.0 / std::numbers::pi;
  return text + ", direction " + rl::formatFloat(angle_deg);
}

/// Of what `things` have between the two level times.
template <class Thing, class Line>
void logBetween(const std::vector<Thing>& things, double after_s, double until_s, Line line) {
  for (std::size_t i = 0; i < things.size() && things[i].time_s <= until_s; ++i) {
    if (things[i].time_s > after_s) line(i, things[i]);
  }
}

}  // namespace

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
  logSpawns(-std::numeric_limits<double>::infinity());
}

void Round::logSpawns(double after_s) {
  if (setup_.logger == nullptr) return;
  const auto log = [this](const char* what, std::size_t i, const auto& thing,
                          const std::string& more = "") {
    setup_.logger->event(clock().time(),
                         fmt::format("{}, number {}, due {}, column {}, row {}{}{}", what, i,
                                     rl::formatFloat(thing.time_s), rl::formatFloat(thing.column),
                                     rl::formatFloat(thing.row), more.empty() ? "" : ", ", more));
  };
  logBetween(level().boxes, after_s, appearedBy(),
             [&](std::size_t i, const Box& box) { log("box_spawn", i, box, demand(box)); });
  logBetween(level().mines, after_s, appearedBy(),
             [&](std::size_t i, const Mine& mine) { log("mine_spawn", i, mine); });
  logBetween(level().walls, after_s, appearedBy(), [&](std::size_t i, const Wall& wall) {
    log("wall_spawn", i, wall,
        fmt::format("width {}, height {}, duration {}", rl::formatFloat(wall.width),
                    rl::formatFloat(wall.height), rl::formatFloat(wall.duration_s)));
  });
}

void Round::logState() {
  if (setup_.logger == nullptr) return;
  const auto pose_of = [this](Hand hand) {
    return saber(hand).held() ? saber(hand).pose() : Pose{};
  };
  const std::array<Pose, 3> poses{pose_of(Hand::kLeft), pose_of(Hand::kRight), head_};
  setup_.logger->state(clock().time(), poses);
}

void Round::logEvent(const Event& event, const char* what, const std::string& more) {
  if (setup_.logger == nullptr) return;
  std::string text = fmt::format("{}, number {}, level time {}, place {}", what, event.index,
                                 rl::formatFloat(event.time_s), rl::formatVector(event.place_m));
  if (event.touch) {
    text += fmt::format(", {}, velocity {}", event.touch->hand == Hand::kLeft ? "left" : "right",
                        rl::formatVector(event.touch->velocity_mps));
  }
  if (!more.empty()) text += ", " + more;
  setup_.logger->event(clock().time(), text);
}

void Round::logCut(const Event& event, const char* what, std::optional<double> angle_deg) {
  const double late_s = event.time_s - level().boxes[event.index].time_s;
  std::string more = "timing " + rl::formatFloat(late_s);
  if (angle_deg) more += ", angle " + rl::formatFloat(*angle_deg);
  logEvent(event, what, more);
}

void Round::logPoints(const OpenCut& cut) {
  if (setup_.logger == nullptr) return;
  setup_.logger->event(
      clock().time(),
      fmt::format("box_points, number {}, points {}, before {}, after {}, centre {}", cut.box,
                  cut.points(), rl::formatFloat(cut.before), rl::formatFloat(cut.after),
                  rl::formatFloat(cut.centre_distance_m)));
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

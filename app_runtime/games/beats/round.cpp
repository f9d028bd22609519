// SPDX-License-Identifier: Apache-2.0
#include "beats/round.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "sim2vr/render/components.hpp"
#include "sim2vr/rl/view_frustum.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::games::beats {
namespace {

constexpr double kSliceEnergy = 0.01;
constexpr double kMissEnergy = -0.15;
constexpr double kWrongCutEnergy = -0.10;
constexpr double kMineEnergy = -0.15;
constexpr double kWallEnergy_per_s = -1.3;

double energyOf(Fault fault) {
  switch (fault) {
    case Fault::kWrongHand:
    case Fault::kWrongDirection:
      return kWrongCutEnergy;
    case Fault::kMine:
      return kMineEnergy;
    case Fault::kMiss:
      return kMissEnergy;
    case Fault::kWall:
      break;  // by the time inside
  }
  return 0.0;
}

constexpr double kSecondsPerNs = 1e-9;
// Frames lie a hair before the grid: those of 20 Hz at multiples of 49.999997 ms.
constexpr double kEndTolerance_s = 1e-3;

// The middle and the corners of the side that faces the player.
std::array<Vec3, 5> frontPoints(const Block& wall) {
  const Vec3 front = wall.center_m - Vec3(0.0, 0.0, wall.half_m.z());
  const double x = wall.half_m.x(), y = wall.half_m.y();
  return {front, front + Vec3(x, y, 0.0), front + Vec3(x, -y, 0.0), front + Vec3(-x, y, 0.0),
          front + Vec3(-x, -y, 0.0)};
}

void transferFlags(Archive& archive, std::string_view name, std::vector<std::uint8_t>& flags) {
  const std::size_t count = flags.size();
  archive.field(name, flags);
  if (flags.size() != count) {
    throw EngineError("saved state: a level with another number of things");
  }
}

}  // namespace

void Tally::addSlice(int points, double speed_mps, double angle_deg) {
  score_ += points * factor();
  ++slices_;
  multiplier_.addSlice();
  longest_combo_ = std::max(longest_combo_, ++combo_);
  speed_sum_mps_ += speed_mps;
  angle_sum_deg_ += angle_deg;
  addEnergy(kSliceEnergy);
}

void Tally::addFault(Fault fault) {
  ++faults_.at(static_cast<std::size_t>(fault));
  combo_ = 0;
  multiplier_.addFault();
  addEnergy(energyOf(fault));
}

void Tally::addWallTime(double seconds, double errors_per_second) {
  wall_s_ += seconds;
  wall_time_errors_ += errors_per_second * seconds;
  addEnergy(kWallEnergy_per_s * seconds);
}

double Tally::errors() const {
  return count(Fault::kWrongHand) + count(Fault::kWrongDirection) + count(Fault::kMine) +
         count(Fault::kWall) + wall_time_errors_;
}

// What is used up stays so.
void Tally::addEnergy(double change) {
  if (energy_ > 0.0) energy_ = std::clamp(energy_ + change, 0.0, 1.0);
}

void Tally::fields(Archive& archive) {
  archive.field("score", score_, kCounts);
  archive.field("slices", slices_, kCounts);
  archive.field("faults", faults_, kCounts);
  archive.field("mines_avoided", mines_avoided_, kCounts);
  archive.field("walls_avoided", walls_avoided_, kCounts);
  archive.field("wall_s", wall_s_, kQuantities);
  archive.field("wall_time_errors", wall_time_errors_, kQuantities);
  archive.field("combo", combo_, kCounts);
  archive.field("longest_combo", longest_combo_, kCounts);
  archive.field("multiplier", multiplier_);
  archive.field("energy", energy_, {0.0, 1.0});
  archive.field("speed_sum", speed_sum_mps_, kQuantities);
  archive.field("angle_sum", angle_sum_deg_, kQuantities);
}

Feedback::Feedback(xr::Session& session, rl::SoundLog& sounds)
    : session_(&session), sounds_(&sounds) {
  xr::ActionSet& set = session.createActionSet("beats");
  xr::Action& vibration = session.createAction(set, "vibrate", XR_ACTION_TYPE_VIBRATION_OUTPUT);
  session.suggestBinding(vibration, "/user/hand/left/output/haptic");
  session.suggestBinding(vibration, "/user/hand/right/output/haptic");
  vibration_ = &vibration;
}

void Feedback::slice(Hand hand, const Vec3& place_m) {
  play("cut", place_m);
  vibrate(hand, {20, 0.5F});
}

void Feedback::wrongCut(Hand hand, const Vec3& place_m) {
  play("bad_cut", place_m);
  vibrate(hand, {60, 0.8F});
}

void Feedback::mine(Hand hand, const Vec3& place_m) {
  play("mine", place_m);
  vibrate(hand, {100, 1.0F});
}

void Feedback::wall(const Vec3& place_m) {
  play("wall", place_m);
  for (const Hand hand : {Hand::kLeft, Hand::kRight}) vibrate(hand, {50, 0.7F});
}

void Feedback::miss(const Vec3& place_m) { play("miss", place_m); }

void Feedback::vibrate(Hand hand, const Pulse& pulse) {
  constexpr XrDuration kNsPerMillisecond = 1'000'000;
  const XrHapticVibration vibration{XR_TYPE_HAPTIC_VIBRATION, nullptr,
                                    pulse.milliseconds * kNsPerMillisecond,
                                    XR_FREQUENCY_UNSPECIFIED, pulse.amplitude};
  session_->applyHapticFeedback(*vibration_, controllerOf(hand), vibration);
}

void Feedback::play(std::string_view sound, const Vec3& place_m) {
  sounds_->play({std::string(sound), place_m});
}

Round::Round(RoundSetup setup, const Feedback& feedback)
    : setup_(std::move(setup)),
      feedback_(feedback),
      tally_(setup_.settings.multiplier),
      sabers_{Saber(Hand::kLeft, *setup_.rig.left_controller, bladeOf(layout())),
              Saber(Hand::kRight, *setup_.rig.right_controller, bladeOf(layout()))},
      boxes_(level().boxes.size()),
      mines_(level().mines.size()),
      walls_(level().walls.size()),
      walls_touched_(level().walls.size(), 0),
      time_s_(-setup_.settings.lead_in_s) {}

void Round::Update() {
  if (phase_ == Phase::kReady) {
    begin();
  } else if (phase_ == Phase::kPlay) {
    play();
  }
}

void Round::begin() {
  phase_ = Phase::kPlay;
  start_ns_ = clock().timeNs();
  head_ = last_head_ = head().transform().pose();
  origin_m_ = settings().floor_origin ? Vec3(0.0, 0.0, head_.position.z()) : head_.position;
  for (Saber& saber : sabers_) saber.follow(0.0);
  followSwings();
  openLog();
}

void Round::play() {
  const double now_s =
      static_cast<double>(clock().timeNs() - start_ns_) * kSecondsPerNs - settings().lead_in_s;
  const double known_s = appearedBy();
  frame_s_ = now_s - time_s_;
  // No time, no motion: the next frame's covers it.
  if (frame_s_ <= 0.0) return;
  time_s_ = now_s;
  last_head_ = std::exchange(head_, head().transform().pose());
  if (settings().floor_origin) origin_m_.z() = head_.position.z();
  for (Saber& saber : sabers_) saber.follow(frame_s_);
  followSwings();
  logSpawns(known_s);
  std::erase_if(bursts_, [this](const Burst& burst) { return time_s_ - burst.time_s > kBurst_s; });

  for (const Event& event : eventsOfFrame()) {
    apply(event);
    if (isOver()) break;
  }
  followCuts();
  if (headInWall()) tally_.addWallTime(frame_s_, settings().wall_errors_per_second);
  logState();
  if (isOver() || time_s_ >= level().length_s - kEndTolerance_s) finish();
}

bool Round::isOver() const {
  if (settings().end_on_miss && tally_.misses() > 0) return true;
  return settings().energy && tally_.energy() <= 0.0;
}

void Round::finish() {
  phase_ = Phase::kDone;
  for (const OpenCut& cut : open_cuts_) closeCut(cut);
  open_cuts_.clear();
  closeLog();
}

Block Round::box(std::size_t i) const {
  return placed(boxAt(layout(), level(), level().boxes[i], time_s_));
}

Block Round::mine(std::size_t i) const {
  return placed(mineAt(layout(), level(), level().mines[i], time_s_));
}

Block Round::wall(std::size_t i) const {
  return placed(wallAt(layout(), level(), level().walls[i], time_s_));
}

Block Round::placed(Block block) const {
  block.center_m += origin_m_;
  return block;
}

std::vector<Round::Event> Round::eventsOfFrame() const {
  std::vector<Event> events;
  for (const std::size_t i : boxesOut()) addBoxEvent(i, events);
  for (const std::size_t i : minesOut()) addMineEvent(i, events);
  for (const std::size_t i : wallsOut()) addWallEvent(i, events);
  std::stable_sort(events.begin(), events.end(),
                   [](const Event& a, const Event& b) { return a.time_s < b.time_s; });
  return events;
}

void Round::addBoxEvent(std::size_t i, std::vector<Event>& events) const {
  const Box& box = level().boxes[i];
  const double pass_s = passTime_s(layout(), level(), box.time_s);
  auto cut = firstTouch(this->box(i), kBladeRadius_m, box.time_s, settings().score.min_speed_mps);
  const auto wide = wideTouch(i);
  if (wide && (!cut || wide->time_s <= cut->time_s)) cut = wide;
  if (cut) {
    events.push_back({cut->time_s, Event::Kind::kCut, i, cut->place_m, cut});
  } else if (pass_s <= time_s_) {
    events.push_back({pass_s, Event::Kind::kMiss, i, this->box(i).center_m});
  }
}

std::optional<Round::Touch> Round::wideTouch(std::size_t i) const {
  const Box& box = level().boxes[i];
  if (!layout().hit_box_m || box.link || !saber(box.hand).held()) return std::nullopt;
  Block block = this->box(i);
  block.half_m = *layout().hit_box_m / 2.0;
  block.center_m.z() -= layout().hit_box_nearer_m;
  const auto touch = touchBy(saber(box.hand), block, kBladeRadius_m, box.time_s);
  const bool fast = touch && touch->velocity_mps.norm() >= settings().score.min_speed_mps;
  return fast && isCorrect(box, *touch) ? touch : std::nullopt;
}

bool Round::isCorrect(const Box& box, const Touch& touch) const {
  const auto angle_deg = cutAngle_deg(box, touch.velocity_mps);
  return touch.hand == box.hand && angle_deg && *angle_deg <= settings().score.angle_limit_deg;
}

void Round::addMineEvent(std::size_t i, std::vector<Event>& events) const {
  const Mine& mine = level().mines[i];
  const double pass_s = passTime_s(layout(), level(), mine.time_s);
  const auto touch =
      firstTouch(this->mine(i), kBladeRadius_m + layout().mine_radius_m, mine.time_s, 0.0);
  if (touch) {
    events.push_back({touch->time_s, Event::Kind::kMineTouched, i, touch->place_m, touch});
  } else if (pass_s <= time_s_) {
    events.push_back({pass_s, Event::Kind::kMineAvoided, i, this->mine(i).center_m});
  }
}

void Round::addWallEvent(std::size_t i, std::vector<Event>& events) const {
  const Wall& wall = level().walls[i];
  const double gone_s = goneTime_s(level(), wall);
  if (walls_touched_[i] == 0) {
    const Vec3 drift_m = driftOfFrame_m();
    Block then = this->wall(i);
    then.center_m -= drift_m;
    const auto share =
        firstContact(Motion(last_head_, head_), Rod{}, then, drift_m, layout().head_radius_m,
                     shareOf(wall.time_s - level().approach_s), shareOf(gone_s));
    if (share) {
      const double time_s = time_s_ - (1.0 - *share) * frame_s_;
      events.push_back({time_s, Event::Kind::kWallTouched, i, head_.position});
    }
  }
  if (gone_s <= time_s_) events.push_back({gone_s, Event::Kind::kWallGone, i, head_.position});
}

std::optional<Round::Touch> Round::firstTouch(const Block& now, double reach_m, double thing_s,
                                              double min_speed_mps) const {
  std::optional<Touch> first;
  for (const Saber& saber : sabers_) {
    if (!saber.held()) continue;
    const auto touch = touchBy(saber, now, reach_m, thing_s);
    if (!touch || touch->velocity_mps.norm() < min_speed_mps) continue;
    if (!first || touch->time_s < first->time_s) first = touch;
  }
  return first;
}

std::optional<Round::Touch> Round::touchBy(const Saber& saber, const Block& now, double reach_m,
                                           double thing_s) const {
  const Vec3 drift_m = driftOfFrame_m();
  Block then = now;
  then.center_m -= drift_m;
  const Motion motion = saber.motion();
  const auto share = firstContact(motion, saber.blade(), then, drift_m, reach_m,
                                  shareOf(thing_s - level().approach_s),
                                  shareOf(passTime_s(layout(), level(), thing_s)));
  if (!share) return std::nullopt;
  const Segment blade = segmentOf(saber.blade(), motion.at(*share));
  const Vec3 place_m = blade.nearestTo(then.center_m + *share * drift_m);
  const Vec3 velocity_mps = motion.velocity(place_m, *share) / frame_s_;
  const Vec3 along = (blade.tip_m - blade.root_m).normalized();
  return Touch{time_s_ - (1.0 - *share) * frame_s_, saber.hand(), place_m,
               velocity_mps - velocity_mps.dot(along) * along};
}

Vec3 Round::driftOfFrame_m() const {
  const double step_m =
      settings().floor_origin ? head_.position.z() - last_head_.position.z() : 0.0;
  return {0.0, 0.0, step_m - level().speed_mps * frame_s_};
}

double Round::shareOf(double time_s) const {
  return std::clamp(1.0 - (time_s_ - time_s) / frame_s_, 0.0, 1.0);
}

bool Round::headInWall() const {
  const Segment middle{head_.position, head_.position};
  const std::vector<std::size_t> out = wallsOut();
  return std::any_of(out.begin(), out.end(), [&](std::size_t i) {
    return distance_m(middle, wall(i)) <= layout().head_radius_m;
  });
}

void Round::apply(const Event& event) {
  switch (event.kind) {
    case Event::Kind::kCut:
      boxes_.finish(event.index);
      applyCut(event);
      break;
    case Event::Kind::kMiss:
      boxes_.finish(event.index);
      tally_.addFault(Fault::kMiss);
      feedback_.miss(event.place_m);
      logEvent(event, "box_miss");
      break;
    case Event::Kind::kMineTouched:
      mines_.finish(event.index);
      tally_.addFault(Fault::kMine);
      feedback_.mine(event.touch->hand, event.place_m);
      bursts_.push_back({event.time_s, event.place_m, Burst::Of::kMine});
      logEvent(event, "mine_hit");
      break;
    case Event::Kind::kMineAvoided:
      mines_.finish(event.index);
      tally_.addAvoidedMine();
      logEvent(event, "mine_avoided");
      break;
    case Event::Kind::kWallTouched:
      walls_touched_[event.index] = 1;
      tally_.addFault(Fault::kWall);
      feedback_.wall(event.place_m);
      logEvent(event, "wall_hit");
      break;
    case Event::Kind::kWallGone:
      walls_.finish(event.index);
      if (walls_touched_[event.index] == 0) {
        tally_.addAvoidedWall();
        logEvent(event, "wall_avoided");
      }
      break;
  }
}

void Round::applyCut(const Event& event) {
  const Touch& touch = *event.touch;
  const Box& box = level().boxes[event.index];
  const ScoreRules& rules = settings().score;
  const auto angle_deg = cutAngle_deg(box, touch.velocity_mps);
  bursts_.push_back({event.time_s, event.place_m,
                     box.hand == Hand::kLeft ? Burst::Of::kLeftBox : Burst::Of::kRightBox});
  if (isCorrect(box, touch)) {
    const double speed_mps = touch.velocity_mps.norm();
    if (rules.swing) {
      OpenCut cut = OpenCut::of(swings_.at(static_cast<std::size_t>(touch.hand)),
                                this->box(event.index).center_m);
      cut.box = event.index;
      cut.hand = touch.hand;
      cut.factor = tally_.factor();
      open_cuts_.push_back(cut);
    }
    const int points = rules.swing ? 0 : cutPoints(rules, speed_mps, *angle_deg);
    tally_.addSlice(points, speed_mps, *angle_deg);
    feedback_.slice(touch.hand, event.place_m);
    logCut(event, "box_slice", angle_deg);
    return;
  }
  const bool right_hand = touch.hand == box.hand;
  tally_.addFault(right_hand ? Fault::kWrongDirection : Fault::kWrongHand);
  feedback_.wrongCut(touch.hand, event.place_m);
  logCut(event, right_hand ? "box_wrong_direction" : "box_wrong_hand", angle_deg);
}

void Round::followSwings() {
  if (!settings().score.swing) return;
  for (const Saber& saber : sabers_) {
    Swing& swing = swings_.at(static_cast<std::size_t>(saber.hand()));
    if (saber.held()) {
      swing.add(time_s_, saber.segment());
    } else {
      swing.clear();
    }
  }
}

void Round::followCuts() {
  std::erase_if(open_cuts_, [this](OpenCut& cut) {
    const Swing& swing = swings_.at(static_cast<std::size_t>(cut.hand));
    if (swing.moves() && !cut.follow(swing)) return false;
    closeCut(cut);
    return true;
  });
}

void Round::closeCut(const OpenCut& cut) {
  tally_.addPoints(cut.points() * cut.factor);
  logPoints(cut);
}

void Round::Burst::fields(Archive& archive) {
  archive.field("time_s", time_s, kQuantities);
  archive.field("place", place_m);
  archive.field("of", of, Of::kMine);
  if (of > Of::kMine) throw EngineError("saved state: sparks of nothing known");
}

void Round::fields(Archive& archive) {
  // Another level must not go on from this state.
  std::string hash = level().hash;
  archive.field("level", hash);
  if (hash != level().hash) {
    throw EngineError("saved state: a round of level " + hash + ", expected " + level().hash +
                      "; the level's file has changed");
  }
  archive.field("tally", tally_);
  archive.field("sabers", sabers_);
  if (settings().score.swing) {
    archive.field("swings", swings_);
    archive.field("open_cuts", open_cuts_);
    for (const OpenCut& cut : open_cuts_) {
      if (cut.box >= level().boxes.size()) throw EngineError("saved state: a cut of no box");
    }
  }
  archive.field("boxes", boxes_);
  archive.field("mines", mines_);
  archive.field("walls", walls_);
  const std::size_t count = walls_touched_.size();
  archive.field("walls_touched", walls_touched_);
  if (walls_touched_.size() != count) throw EngineError("saved state: another number of walls");
  archive.field("phase", phase_, Phase::kDone);
  archive.field("start_ns", start_ns_, {0.0, 9.0e18});
  archive.field("time_s", time_s_, kQuantities);
  archive.field("frame_s", frame_s_, kQuantities);
  archive.field("origin", origin_m_);
  archive.field("head", head_);
  archive.field("last_head", last_head_);
  archive.field("bursts", bursts_);
}

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

Sight::Sight(const Round& round, double aspect)
    : round_(&round),
      aspect_(aspect),
      boxes_(round.level().boxes.size(), 0),
      mines_(round.level().mines.size(), 0),
      walls_(round.level().walls.size(), 0) {}

void Sight::look() {
  const auto& camera = *round_->head().getComponent<render::Camera>();
  const auto visible = [&](const Vec3& point_m) { return rl::inView(camera, aspect_, point_m); };
  for (const std::size_t i : round_->boxesOut()) {
    if (boxes_[i] == 0 && visible(round_->box(i).center_m)) boxes_[i] = 1;
  }
  for (const std::size_t i : round_->minesOut()) {
    if (mines_[i] == 0 && visible(round_->mine(i).center_m)) mines_[i] = 1;
  }
  for (const std::size_t i : round_->wallsOut()) {
    if (walls_[i] == 0 && std::ranges::any_of(frontPoints(round_->wall(i)), visible)) walls_[i] = 1;
  }
}

std::vector<std::size_t> Sight::seen(std::vector<std::size_t> out, const Flags& flags) {
  std::erase_if(out, [&flags](std::size_t i) { return flags[i] == 0; });
  return out;
}

std::vector<std::size_t> Sight::boxes(Hand hand) const {
  std::vector<std::size_t> of_hand = boxes();
  std::erase_if(of_hand, [&](std::size_t i) { return round_->level().boxes[i].hand != hand; });
  return of_hand;
}

std::optional<double> Sight::bladeToBox_m(Hand hand) const {
  const std::vector<std::size_t> next = boxes(hand);
  const Saber& saber = round_->saber(hand);
  if (next.empty() || !saber.held()) return std::nullopt;
  const double gap_m = distance_m(saber.segment(), round_->box(next.front())) - kBladeRadius_m;
  return std::max(0.0, gap_m);
}

void Sight::fields(Archive& archive) {
  transferFlags(archive, "boxes", boxes_);
  transferFlags(archive, "mines", mines_);
  transferFlags(archive, "walls", walls_);
}

}  // namespace sim2vr::games::beats

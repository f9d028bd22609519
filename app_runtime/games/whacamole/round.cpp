// SPDX-License-Identifier: Apache-2.0
#include "whacamole/round.hpp"

#include <fmt/format.h>

#include <utility>
#include <vector>

#include "sim2vr/scene/scene.hpp"
#include "whacamole/hammer.hpp"
#include "whacamole/looks.hpp"
#include "whacamole/target.hpp"

namespace sim2vr::games::whacamole {

double CellTally::failRate(int cell) const {
  const auto i = static_cast<std::size_t>(cell);
  const int total = hits[i] + misses[i];
  return total == 0 ? 0.0 : static_cast<double>(misses[i]) / total;
}

std::array<double, kCells> CellTally::failRates() const {
  std::array<double, kCells> rates{};
  for (int cell = 0; cell < kCells; ++cell) rates[static_cast<std::size_t>(cell)] = failRate(cell);
  return rates;
}

void CellTally::fields(Archive& archive) {
  archive.field("hits", hits, kCounts);
  archive.field("misses", misses, kCounts);
}

void Counts::fields(Archive& archive) {
  archive.field("hits", hits, kCounts);
  archive.field("misses", misses, kCounts);
  archive.field("contacts", contacts, kCounts);
  archive.field("first_contacts", first_contacts, kCounts);
  archive.field("last_contact_strike_mps", last_contact_strike_mps, kQuantities);
  archive.field("hit_speed_sum_mps", hit_speed_sum_mps, kQuantities);
  archive.field("hit_latency_sum_s", hit_latency_sum_s, kQuantities);
  archive.field("depth_z_sum_m", depth_z_sum_m, kQuantities);
  archive.field("depth_normal_sum_m", depth_normal_sum_m, kQuantities);
  archive.field("play_frames", play_frames, kCounts);
}

Round::Round(RoundSetup setup)
    : setup_(std::move(setup)),
      place_(geometry(setup_.condition.placement, setup_.settings.hand, setup_.settings.area)),
      spawner_(setup_.seed, setup_.settings.spawn_weights, setup_.settings.spawns) {}

void Round::Update() {
  switch (phase_) {
    case Phase::kReady:
      placeArea();
      phase_start_s_ = clock().time();
      if (setup_.settings.countdown_s > 0.0F) {
        phase_ = Phase::kCountdown;
      } else {
        startPlay();
      }
      break;
    case Phase::kCountdown:
      if (clock().time() - phase_start_s_ >= setup_.settings.countdown_s) startPlay();
      break;
    case Phase::kPlay:
      play();
      break;
    case Phase::kDone:
      break;
  }
}

void Round::placeArea() {
  const Vec3 head = setup_.rig.camera->transform().position();
  setup_.area->transform().setPose({head + place_.offset_m, place_.rotation});
  if (scene::GameObject* spectator = scene().find(rl::kSpectatorCameraPath)) {
    spectator->transform().setPose(spectatorPose(head, setup_.settings.hand));
  }
  setup_.area->setActive(true);
  openLog();
}

// Play itself begins with the next frame, as in the reference.
void Round::startPlay() {
  phase_ = Phase::kPlay;
  phase_start_s_ = clock().time();
}

void Round::play() {
  logState();
  measureDepth();
  if (elapsed_s() > setup_.settings.round_s) {
    finish();
    return;
  }
  trySpawn();
}

float Round::elapsed_s() const {
  const bool begun = phase_ == Phase::kPlay || phase_ == Phase::kDone;
  return begun ? clock().time() - phase_start_s_ : 0.0F;
}

void Round::finish() {
  phase_ = Phase::kDone;
  std::vector<scene::GameObject*> live;
  scene().forEach<Target>([&live](Target& target) { live.push_back(&target.gameObject()); });
  for (scene::GameObject* object : live) scene().destroy(*object);
  setup_.area->setActive(false);
  const int ended = counts_.hits + counts_.misses;
  const double hit_rate = static_cast<double>(counts_.hits) / ended;  // NaN when nothing ended
  logEvent(fmt::format("episode statistics, contacts {}, hits {}, misses {}, hit rate {}",
                       counts_.contacts, counts_.hits, counts_.misses, rl::formatFloat(hit_rate)));
  if (setup_.logger != nullptr) setup_.logger->endRound();
}

void Round::trySpawn() {
  int live = 0;
  scene().forEach<Target>([&live](Target&) { ++live; });
  const auto spawn = spawner_.next(clock().time(), live, setup_.condition.max_targets);
  if (!spawn) return;
  scene::GameObject& object =
      scene().instantiate(kTargetPrefab, "Target " + std::to_string(spawn->id), setup_.area);
  auto& target = *object.getComponent<Target>();
  target.begin(*spawn);
  logTarget("target_spawn", target);
}

void Round::measureDepth() {
  const scene::Transform& area = setup_.area->transform();
  const Vec3 offset = setup_.hammer->markerPosition() - area.position();
  counts_.depth_z_sum_m += offset.z();
  counts_.depth_normal_sum_m += offset.dot(area.forward());
  ++counts_.play_frames;
}

bool Round::isHit(const Vec3& velocity_mps) const {
  if (!setup_.condition.constrained) return true;
  return static_cast<float>(strikeSpeed_mps(velocity_mps)) > setup_.settings.strike_threshold_mps;
}

void Round::recordHit(const Target& target, const Vec3& velocity_mps) {
  ++counts_.hits;
  ++setup_.tally->hits[static_cast<std::size_t>(target.cell())];
  counts_.hit_speed_sum_mps += velocity_mps.norm();
  counts_.hit_latency_sum_s += static_cast<double>(clock().time() - target.spawnFrameTime_s());
  logTarget("target_hit", target, velocity_mps);
}

void Round::recordContact(const Target& target, const Vec3& velocity_mps, bool first) {
  ++counts_.contacts;
  if (first) ++counts_.first_contacts;
  counts_.last_contact_strike_mps = strikeSpeed_mps(velocity_mps);
  logTarget("target_contact", target, velocity_mps);
}

void Round::recordMiss(const Target& target) {
  ++counts_.misses;
  ++setup_.tally->misses[static_cast<std::size_t>(target.cell())];
  logTarget("target_miss", target);
}

void Round::recordRemoval(const Target& target) { spawner_.release(target.cell()); }

void Round::openLog() {
  if (setup_.logger == nullptr) return;
  static const std::vector<std::string> kPoses{"left", "right", "head", "marker"};
  setup_.logger->beginRound(setup_.condition.name, setup_.seed, kPoses);
  logState();
  const std::string options = setup_.settings.playOptionsJson();
  if (options != "{}") logEvent("game options " + options);
  const scene::Transform& area = setup_.area->transform();
  logEvent("target plane transform " + rl::formatPose(area.pose()));
  std::string mapping = "grid mapping";
  for (int cell = 0; cell < kCells; ++cell) {
    const Vec3 center = cellCenter_m(cell, setup_.settings);
    mapping +=
        fmt::format(" [{} {} {} {} {} {}]", cell, cell / 3, cell % 3, rl::formatFloat(center.x()),
                    rl::formatFloat(center.y()), rl::formatVector(area.transformPoint(center)));
  }
  logEvent(mapping);
}

void Round::logState() {
  if (setup_.logger == nullptr) return;
  const scene::GameObject& left = *setup_.rig.left_controller;
  const std::array<Pose, 4> poses{left.activeInHierarchy() ? left.transform().pose() : Pose{},
                                  setup_.rig.right_controller->transform().pose(),
                                  setup_.rig.camera->transform().pose(),
                                  setup_.hammer->markerPose()};
  setup_.logger->state(clock().time(), poses);
}

void Round::logEvent(const std::string& text) {
  if (setup_.logger != nullptr) setup_.logger->event(clock().time(), text);
}

void Round::logTarget(const char* what, const Target& target,
                      const std::optional<Vec3>& velocity_mps) {
  if (setup_.logger == nullptr) return;
  std::string text = fmt::format("{}, target ID {}, grid ID {}", what, target.id(), target.cell());
  if (velocity_mps) text += ", velocity " + rl::formatVector(*velocity_mps);
  logEvent(text);
}

void Round::fields(Archive& archive) {
  archive.field("spawner", spawner_);
  archive.field("counts", counts_);
  archive.field("phase", phase_, Phase::kDone);
  archive.field("phase_start_s", phase_start_s_, kQuantities);
}

}  // namespace sim2vr::games::whacamole

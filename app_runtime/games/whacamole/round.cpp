// SPDX-License-Identifier: Apache-2.0
#include "whacamole/round.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <numeric>
#include <utility>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/physics/collider.hpp"
#include "sim2vr/scene/scene.hpp"
#include "whacamole/looks.hpp"

namespace sim2vr::games::whacamole {
namespace {

constexpr float kMaximumPause_s = 0.5F;
constexpr float kTargetSize_m = 0.025F;
constexpr float kLife_s = 1.0F;

// Hit volume in target units, reaching 2.5 mm in front of the target plane.
const Vec3 kTriggerSize(1.8, 1.8, 1.0);
const Vec3 kTriggerCenter(0.0, 0.0, -0.6);

// A collider needs some size.
constexpr float kSmallestScale = 1e-3F;
constexpr float kShortest_s = 1e-3F;

constexpr double kScale = 0.1;

// In the right controller's frame (docs/reference/games/whacamole.md, "Hammer").
const Vec3 kPosition_m(0.0096, -0.0491, -0.0545);
const Quat kRotation = Quat(0.63740873, 0.30295587, 0.6412905, 0.301122).normalized();

// In hammer units (a tenth of a metre).
const Vec3 kMarker(-0.482, 1.385, -0.005);
const Vec3 kHeadSize(1.0, 0.55, 0.55);
const Vec3 kHeadCenter(-0.004010893, 1.3975825, -0.008178129);

// A left hand's hammer is the mirror image, x turned round in the controller's frame. Its own frame
// is mirrored along z, so that the striking face still looks along -x and the handle along y.
Vec3 ofHand(xr::Hand hand, const Vec3& in_hammer) {
  return hand == xr::Hand::left ? Vec3(in_hammer.x(), in_hammer.y(), -in_hammer.z()) : in_hammer;
}

Pose mount(xr::Hand hand) {
  if (hand == xr::Hand::right) return {kPosition_m, kRotation};
  // With reflections X and Z of those axes X R Z = (X R X)(X Z), and X Z is half a turn about y.
  const Quat mirrored(kRotation.w(), kRotation.x(), -kRotation.y(), -kRotation.z());
  return {Vec3(-kPosition_m.x(), kPosition_m.y(), kPosition_m.z()),
          mirrored * Quat(0.0, 0.0, 1.0, 0.0)};
}

}  // namespace

Spawner::Spawner(std::uint32_t seed, CellWeights weights, std::vector<ScheduledSpawn> schedule)
    : random_(seed), weights_(std::move(weights)), schedule_(std::move(schedule)) {}

std::optional<Spawn> Spawner::next(float time_s, int live, int max_targets) {
  if (!schedule_.empty()) return nextScheduled(time_s);
  if (live >= max_targets || !(time_s > pause_end_s_) || free_.empty()) return std::nullopt;
  // The order of the draws is the reference's; a size of fixed range still costs a draw.
  pause_end_s_ = time_s + random_.range(0.0F, kMaximumPause_s);
  random_.range(kTargetSize_m, kTargetSize_m);
  Spawn spawn;
  spawn.cell = takeCell();
  random_.range(kLife_s, kLife_s);
  spawn.id = next_id_++;
  return spawn;
}

std::optional<Spawn> Spawner::nextScheduled(float time_s) {
  const auto next = static_cast<std::size_t>(next_id_);
  if (next >= schedule_.size() || time_s < schedule_[next].time_s) return std::nullopt;
  return Spawn{.id = next_id_++, .cell = schedule_[next].cell};
}

int Spawner::takeCell() {
  if (!weights_.empty()) return takeWeightedCell();
  random_.shuffle(free_);
  const int cell = free_.front();
  free_.erase(free_.begin());
  return cell;
}

int Spawner::takeWeightedCell() {
  float total = 0.0F;
  for (const int cell : free_) total += weights_[static_cast<std::size_t>(cell)];
  float left = random_.range(0.0F, total);
  auto chosen = free_.end() - 1;
  for (auto it = free_.begin(); it != free_.end(); ++it) {
    left -= weights_[static_cast<std::size_t>(*it)];
    if (left < 0.0F) {
      chosen = it;
      break;
    }
  }
  const int cell = *chosen;
  free_.erase(chosen);
  return cell;
}

void Spawner::fields(Archive& archive) {
  archive.field("random", random_);
  archive.field("weights", weights_, {0.0, 1.0e3});
  if (!weights_.empty() && weights_.size() != kCells) {
    throw EngineError("saved state: field 'weights': got " + std::to_string(weights_.size()) +
                      " numbers, expected " + std::to_string(kCells) + " or none");
  }
  archive.field("free", free_, {0.0, kCells - 1});
  archive.field("pause_end_s", pause_end_s_, kQuantities);
  archive.field("next_id", next_id_, kCounts);
}

CellWeights adaptiveWeights(const std::array<double, kCells>& fail_rates) {
  const double mean = std::accumulate(fail_rates.begin(), fail_rates.end(), 0.0) / kCells;
  if (mean <= 0.0) return {};
  CellWeights weights;
  for (const double rate : fail_rates) weights.push_back(static_cast<float>(rate + mean));
  return weights;
}

Vec3 cellCenter_m(int cell, const Settings& settings) {
  const double pitch_m = settings.area_size_m / 2.0;
  const int row = cell / 3;
  const int column = cell % 3;
  return {(column - 1) * pitch_m, (1 - row) * pitch_m, 0.0};
}

Vec3 targetOrigin_m(int cell, const Settings& settings) {
  return cellCenter_m(cell, settings) + Vec3(0.0, 0.0, settings.target_radius_m);
}

void registerTargetPrefab(scene::Scene& scene, Round& round, const Hammer& hammer) {
  scene.registerPrefab(kTargetPrefab, [&round, &hammer](scene::GameObject& object) {
    object.setLayer(kTargetLayer);
    object.transform().setLocalScale(round.settings().target_radius_m);
    object.addComponent<physics::Rigidbody>();
    object.addComponent<physics::Collider>(physics::Box{kTriggerSize}, kTriggerCenter,
                                           /*is_trigger=*/true);
    object.addComponent<TargetLooks>();
    object.addComponent<Target>(round, hammer);
  });
}

double Target::radius_m() const { return round_.settings().target_radius_m; }

void Target::Awake() { looks_ = gameObject().getComponent<TargetLooks>(); }

void Target::begin(const Spawn& spawn) {
  id_ = spawn.id;
  cell_ = spawn.cell;
  transform().setLocalPosition(targetOrigin_m(cell_, round_.settings()));
  spawn_time_ = clock().fixedTime();
  spawn_frame_time_ = clock().time();
  expiry_ = spawn_time_ + (round_.settings().life_s + round_.settings().fade_in_s);
  if (round_.settings().fade_in_s <= 0.0F) state_ = State::kAlive;
  looks_->showAge(0.0);
}

Vec3 Target::hitCenter_m() const {
  return transform().position() + transform().rotation() * (kTriggerCenter * radius_m());
}

void Target::FixedUpdate() {
  if (state_ == State::kAlive && clock().fixedTime() >= expiry_) {
    endLife(/*was_hit=*/false);
    round_.recordMiss(*this);
  }
}

void Target::OnTriggerEnter(const scene::TriggerContact&) {
  if (state_ != State::kAlive) return;
  const Vec3 velocity = hammer_.velocity_mps();
  if (round_.isHit(velocity)) {
    endLife(/*was_hit=*/true);
    round_.recordHit(*this, velocity);
    return;
  }
  round_.recordContact(*this, velocity, /*first=*/!touched_);
  touched_ = true;
}

void Target::Update() {
  if (state_ == State::kFadeOut) {
    fadeOut();
    return;
  }
  const float age_s = clock().time() - spawn_time_;
  if (state_ == State::kFadeIn) fadeIn(age_s);
  if (state_ != State::kAlive) return;
  const Settings& settings = round_.settings();
  looks_->showAge((age_s - settings.fade_in_s) / std::max(settings.life_s, kShortest_s));
}

void Target::fadeIn(float age_s) {
  const float fade_in_s = round_.settings().fade_in_s;
  const bool done = age_s > fade_in_s;
  const float scale = done ? 1.0F : std::max(age_s / fade_in_s, kSmallestScale);
  transform().setLocalScale(radius_m() * scale);
  if (done) state_ = State::kAlive;
}

void Target::fadeOut() {
  const float elapsed_s = clock().time() - end_time_;
  if (elapsed_s > kFadeOut_s) {
    round_.recordRemoval(*this);
    scene().destroy(gameObject());
    return;
  }
  if (was_hit_) {
    looks_->showBurst(elapsed_s);
    return;
  }
  looks_->showMissed();
  transform().setLocalScale(radius_m() * std::max(1.0F - elapsed_s / kFadeOut_s, kSmallestScale));
}

void Target::endLife(bool was_hit) {
  state_ = State::kFadeOut;
  // A miss fades from when its life was over, not from the step that noticed it.
  end_time_ = was_hit ? clock().fixedTime() : expiry_;
  was_hit_ = was_hit;
}

void Target::fields(Archive& archive) {
  archive.field("state", state_, State::kFadeOut);
  archive.field("id", id_, kCounts);
  archive.field("cell", cell_, {0.0, kCells - 1});
  archive.field("spawn_time", spawn_time_, kQuantities);
  archive.field("spawn_frame_time", spawn_frame_time_, kQuantities);
  archive.field("expiry", expiry_, kQuantities);
  archive.field("end_time", end_time_, kQuantities);
  archive.field("touched", touched_);
  archive.field("was_hit", was_hit_);
}

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
                                        : transform().transformPoint(ofHand(hand_, kHeadCenter));
}

void Hammer::fields(Archive& archive) {
  archive.field("velocity", velocity_);
  archive.field("last_position", last_position_);
  archive.field("has_position", has_position_);
}

Hammer& buildHammer(scene::GameObject& controller, const Settings& settings) {
  scene::Scene& scene = controller.scene();
  scene::GameObject& object = scene.create("Hammer", &controller);
  object.setLayer(kPlayerLayer);
  const Pose held = mount(settings.hand);
  object.transform().setLocalPosition(held.position);
  object.transform().setLocalRotation(held.rotation);
  object.transform().setLocalScale(kScale);
  auto& hammer = object.addComponent<Hammer>(settings);
  const Vec3 margin = Vec3::Constant(2.0 * settings.hammer_margin_m / kScale);
  object.addComponent<physics::Collider>(physics::Box{kHeadSize + margin},
                                         ofHand(settings.hand, kHeadCenter), /*is_trigger=*/false);
  scene::GameObject& marker = scene.create("Marker", &object);
  marker.transform().setLocalPosition(ofHand(settings.hand, kMarker));
  hammer.setMarker(marker);
  addHammerLooks(object);
  return hammer;
}

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

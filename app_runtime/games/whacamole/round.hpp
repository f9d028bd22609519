// SPDX-License-Identifier: Apache-2.0
// The course of a round: placing the area, countdown, play, end; and everything it counts.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/random.hpp"
#include "sim2vr/rl/episode_logger.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/component.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "whacamole/conditions.hpp"

namespace sim2vr::games::whacamole {

// Physics layers of Whac-A-Mole. Only this pair collides.

inline constexpr int kTargetLayer = 10;
inline constexpr int kPlayerLayer = 11;

// When and where the next target appears, drawn or from a list: the only user of the round's random
// numbers.

struct Spawn {
  int id = 0;
  int cell = 0;
};

class Spawner {
 public:
  /// Draws the spawns, or takes them from `schedule` where that is not empty.
  Spawner(std::uint32_t seed, CellWeights weights, std::vector<ScheduledSpawn> schedule = {});

  /// A spawn at frame time `time_s`, or nothing. Drawn: nothing when `live` targets (fading ones
  /// included) are already `max_targets`, or the pause after the last spawn is not over. From the
  /// schedule: the next one that is due, whatever lives.
  std::optional<Spawn> next(float time_s, int live, int max_targets);

  /// Gives a cell back once its target has disappeared.
  void release(int cell) {
    if (schedule_.empty()) free_.push_back(cell);
  }

  void fields(Archive& archive);

 private:
  std::optional<Spawn> nextScheduled(float time_s);
  int takeCell();
  int takeWeightedCell();

  Random random_;
  CellWeights weights_;
  std::vector<ScheduledSpawn> schedule_;
  std::vector<int> free_{0, 3, 6, 1, 4, 7, 2, 5, 8};
  float pause_end_s_ = 0.0F;
  int next_id_ = 0;
};

/// Adaptive curriculum: weight_i = fail rate_i + mean fail rate, of the last round. Equal weights
/// (none) when nothing failed.
CellWeights adaptiveWeights(const std::array<double, kCells>& fail_rates);

// One mole: fades in, can be hit for a second, fades out.

class Hammer;
class Round;
class TargetLooks;

inline constexpr float kFadeOut_s = 0.3F;

/// All times are binary32 on the scene's clock, as in the reference: when a miss falls between two
/// fixed steps, the rounding decides.
class Target : public scene::Component {
 public:
  enum class State { kFadeIn, kAlive, kFadeOut };

  /// The target of `round`, struck by `hammer`; both outlive it.
  Target(Round& round, const Hammer& hammer) : round_(round), hammer_(hammer) {}

  std::string_view typeName() const override { return "whacamole.Target"; }
  void Awake() override;
  /// Starts the life of a fresh target; the spawn time is the latest fixed time.
  void begin(const Spawn& spawn);

  /// Expiry. Precedes the step's overlap test.
  void FixedUpdate() override;
  void OnTriggerEnter(const scene::TriggerContact& contact) override;
  void Update() override;
  void fields(Archive& archive) override;

  int id() const { return id_; }
  int cell() const { return cell_; }
  State state() const { return state_; }
  /// The fixed time that its life counts from.
  /// The time of the frame in which it appeared.
  float spawnFrameTime_s() const { return spawn_frame_time_; }
  /// When it can no longer be hit.
  float expiry_s() const { return expiry_; }
  /// World position of the middle of its hit volume, full-grown.
  Vec3 hitCenter_m() const;

 private:
  double radius_m() const;
  void fadeIn(float age_s);
  void fadeOut();
  void endLife(bool was_hit);

  Round& round_;
  const Hammer& hammer_;
  TargetLooks* looks_ = nullptr;
  State state_ = State::kFadeIn;
  int id_ = 0;
  int cell_ = 0;
  float spawn_time_ = 0.0F;
  float spawn_frame_time_ = 0.0F;
  float expiry_ = 0.0F;
  float end_time_ = 0.0F;
  bool touched_ = false;
  bool was_hit_ = false;
};

/// Centre of a cell in the target area's frame; ids run row-wise from the top left as the player
/// sees it.
Vec3 cellCenter_m(int cell, const Settings& settings = {});
/// Where a target's origin sits: a radius behind the plane, so that its front is in the plane.
Vec3 targetOrigin_m(int cell, const Settings& settings = {});

/// Registers the prefab "Target" for targets of `round`.
void registerTargetPrefab(scene::Scene& scene, Round& round, const Hammer& hammer);
inline constexpr const char* kTargetPrefab = "Target";

// The hammer in the player's hand.

/// Measures the hammer's velocity: that of its root (the pivot near the hand, not the head), per
/// frame, low-pass filtered as v <- v + 0.5 (raw - v), from 0 at the start. The settings can choose
/// the head and another factor.
class Hammer : public scene::Component {
 public:
  explicit Hammer(const Settings& settings)
      : smoothing_(settings.velocity_smoothing),
        point_(settings.velocity_point),
        hand_(settings.hand) {}

  std::string_view typeName() const override { return "whacamole.Hammer"; }
  void Update() override;
  void fields(Archive& archive) override;

  /// Smoothed velocity of the latest frame, m/s, world axes.
  const Vec3& velocity_mps() const { return velocity_; }
  /// Pose of the marker, the centre of the striking face.
  Pose markerPose() const { return marker_->transform().pose(); }
  Vec3 markerPosition() const { return marker_->transform().position(); }

  void setMarker(const scene::GameObject& marker) { marker_ = &marker; }

 private:
  Vec3 measuredPoint() const;

  double smoothing_;
  VelocityPoint point_;
  xr::Hand hand_;
  const scene::GameObject* marker_ = nullptr;
  Vec3 velocity_ = Vec3::Zero();
  Vec3 last_position_ = Vec3::Zero();
  bool has_position_ = false;
};

/// Builds hammer, marker and hit collider below the controller of the hand of the settings.
Hammer& buildHammer(scene::GameObject& controller, const Settings& settings);

class Hammer;
class Target;

/// Outcomes per cell. The game keeps it beyond the round for the adaptive curriculum.
struct CellTally {
  std::array<int, kCells> hits{};
  std::array<int, kCells> misses{};

  /// misses / (hits + misses), 0 when nothing happened.
  double failRate(int cell) const;
  std::array<double, kCells> failRates() const;
  void fields(Archive& archive);
};

/// What the round counted so far. Score = hits.
struct Counts {
  int hits = 0;
  int misses = 0;
  int contacts = 0;        // touches of a live target that were too slow for a hit
  int first_contacts = 0;  // of those, the first per target
  double last_contact_strike_mps = 0.0;
  double hit_speed_sum_mps = 0.0;   // norm of the smoothed velocity at each hit
  double hit_latency_sum_s = 0.0;   // from spawn to hit
  double depth_z_sum_m = 0.0;       // marker minus area origin along world z, per play frame
  double depth_normal_sum_m = 0.0;  // the same along the area's normal; negative = in front
  int play_frames = 0;

  void fields(Archive& archive);
};

struct RoundSetup {
  Settings settings;
  Condition condition;
  std::uint32_t seed = 0;
  rl::XrRig rig;
  scene::GameObject* area = nullptr;
  const Hammer* hammer = nullptr;
  CellTally* tally = nullptr;
  rl::EpisodeLogger* logger = nullptr;
};

/// Order 0 and built before any target, after the hammer: a frame computes the hammer's velocity,
/// then the round logs, ends or spawns, then the targets age.
class Round : public scene::Component {
 public:
  enum class Phase { kReady, kCountdown, kPlay, kDone };

  explicit Round(RoundSetup setup);

  std::string_view typeName() const override { return "whacamole.Round"; }
  void Update() override;
  void fields(Archive& archive) override;

  Phase phase() const { return phase_; }
  const Settings& settings() const { return setup_.settings; }
  const Condition& condition() const { return setup_.condition; }
  const Counts& counts() const { return counts_; }
  const CellTally& tally() const { return *setup_.tally; }
  const Hammer& hammer() const { return *setup_.hammer; }
  /// Game seconds since play began, 0 before.
  float elapsed_s() const;

  /// The component of a velocity that constrained hits are judged by.
  double strikeSpeed_mps(const Vec3& velocity_mps) const {
    return strikeSpeed(place_, velocity_mps);
  }
  bool isHit(const Vec3& velocity_mps) const;
  // What the targets report; the time is the clock's.
  void recordHit(const Target& target, const Vec3& velocity_mps);
  void recordContact(const Target& target, const Vec3& velocity_mps, bool first);
  void recordMiss(const Target& target);
  void recordRemoval(const Target& target);

 private:
  void placeArea();
  void startPlay();
  void play();
  void finish();
  void trySpawn();
  void measureDepth();

  void openLog();
  void logState();
  void logEvent(const std::string& text);
  void logTarget(const char* what, const Target& target,
                 const std::optional<Vec3>& velocity_mps = std::nullopt);

  RoundSetup setup_;
  PlacementGeometry place_;
  Spawner spawner_;
  Counts counts_;
  Phase phase_ = Phase::kReady;
  float phase_start_s_ = 0.0F;
};

}  // namespace sim2vr::games::whacamole

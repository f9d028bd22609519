// SPDX-License-Identifier: Apache-2.0
// The course of a round: placing the area, countdown, play, end; and everything it counts.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "sim2vr/rl/episode_logger.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/component.hpp"
#include "whacamole/conditions.hpp"
#include "whacamole/spawner.hpp"

namespace sim2vr::games::whacamole {

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

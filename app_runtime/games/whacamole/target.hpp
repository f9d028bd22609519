// SPDX-License-Identifier: Apache-2.0
// One mole: fades in, can be hit for a second, fades out.
#pragma once

#include "sim2vr/scene/component.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "whacamole/conditions.hpp"
#include "whacamole/spawner.hpp"

namespace sim2vr::games::whacamole {

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

}  // namespace sim2vr::games::whacamole

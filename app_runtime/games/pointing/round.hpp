// SPDX-License-Identifier: Apache-2.0
// The course of a round: blocks of targets, one up at a time, and what became of each.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "pointing/rules.hpp"
#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/math.hpp"
#include "sim2vr/rl/episode_logger.hpp"
#include "sim2vr/rl/sound.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/component.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::pointing {

// What the player hears and feels.

class Feedback {
 public:
  /// Makes the game's action set, before the rig attaches all of them. Both outlive it.
  Feedback(xr::Session& session, rl::SoundLog& sounds, xr::Hand hand);

  void hit(const Vec3& place_m) { selection("hit", place_m); }
  void error(const Vec3& place_m) { selection("error", place_m); }
  void timeout(const Vec3& place_m) { sounds_->play({"timeout", place_m}); }

 private:
  /// Touching the plane is felt wherever it is touched.
  void selection(std::string_view sound, const Vec3& place_m);

  xr::Session* session_;
  rl::SoundLog* sounds_;
  xr::Hand hand_;
  const xr::Action* vibration_;
};

// The stylus in the player's hand, and where its tip comes through the target plane.

/// The tip came through the plane, from the player's side.
struct Crossing {
  /// World, on the plane.
  Vec3 place_m = Vec3::Zero();
  float time_s = 0.0F;
};

class Stylus {
 public:
  /// The tip lies `length_m` in front of the grip, along its z axis. `controller` outlives it.
  Stylus(const scene::GameObject& controller, double length_m, double rearm_m)
      : controller_(&controller), length_m_(length_m), rearm_m_(rearm_m) {}

  /// Takes over where the tip is in the frame of time `time_s`, and says whether and where it came
  /// through the plane z = `plane_z_m` since the frame before: on the straight line between the two
  /// places. After each crossing it must come back by `rearm_m` in front of the plane before the
  /// next one counts.
  std::optional<Crossing> follow(float time_s, double plane_z_m);

  /// Whether the controller is on.
  bool held() const { return held_; }
  Pose tipPose() const;
  const Vec3& tip_m() const { return tip_m_; }
  /// Over the last frame.
  const Vec3& velocity_mps() const { return velocity_mps_; }
  /// Whether the next way through the plane is a selection.
  bool armed() const { return armed_; }

  void fields(Archive& archive);

 private:
  const scene::GameObject* controller_;
  double length_m_;
  double rearm_m_;
  bool held_ = false;
  bool armed_ = false;
  float time_s_ = 0.0F;
  Vec3 tip_m_ = Vec3::Zero();
  Vec3 velocity_mps_ = Vec3::Zero();
};

enum class Outcome { kNone, kHit, kError, kTimeout };

struct RoundSetup {
  Settings settings;
  std::uint32_t seed = 0;
  rl::XrRig rig;
  Stylus stylus;
  Feedback feedback;
  rl::EpisodeLogger* logger = nullptr;
};

/// The first frame puts the circle before the head and the first target up. A selection or a
/// time-out ends a trial, and the next target is up in the same frame. A block has a trial more
/// than targets: the first one brings the player to the circle, and only the others can be
/// movements, from one selection to the next.
class Round : public scene::Component {
 public:
  enum class Phase { kReady, kPlay, kDone };

  explicit Round(RoundSetup setup);

  std::string_view typeName() const override { return "pointing.Round"; }
  void Update() override;
  void fields(Archive& archive) override;

  Phase phase() const { return phase_; }
  const Settings& settings() const { return setup_.settings; }
  const Stylus& stylus() const { return setup_.stylus; }
  const Tally& tally() const { return tally_; }
  const std::vector<Block>& blocks() const { return blocks_; }
  /// The present block; the last one when the round is over.
  const Block& block() const { return blocks_.at(static_cast<std::size_t>(block_)); }
  int trial() const { return trial_; }
  /// Of the target that is up; counts up from 0 in a round.
  int targetId() const { return target_id_; }
  /// Trials that are over / all of them.
  double progress() const;
  /// Game seconds since the present target came up.
  float age_s() const { return clock().time() - appeared_s_; }

  /// World, of the circle.
  const Vec3& center_m() const { return center_m_; }
  /// World centre of a target of the present block.
  Vec3 targetCenter(int target) const;
  /// The target that is up, and the one that will be after it; none in the last trial of a block.
  int target() const { return targetOfTrial(trial_, settings().targets); }
  std::optional<int> nextTarget() const;

  /// What happened last, to a target of what place and width, and when; for looks.
  Outcome lastOutcome() const { return last_outcome_; }
  const Vec3& lastCenter_m() const { return last_center_m_; }
  double lastWidth_m() const { return last_width_m_; }
  float lastOutcome_s() const { return last_outcome_s_; }

 private:
  struct Selection {
    Vec3 place_m = Vec3::Zero();
    float time_s = 0.0F;
    void fields(Archive& archive) {
      archive.field("place_m", place_m);
      archive.field("time_s", time_s, kQuantities);
    }
  };

  void begin();
  void play();
  void putUp();
  void select(const Crossing& crossing);
  void timeOut();
  void endTrial(Outcome outcome, const std::optional<Selection>& selection);
  void endBlock();
  void finish();

  void openLog();
  void logState();
  void logBlock();
  void logTarget();
  void logSelection(bool hit, const Crossing& crossing, const std::optional<Movement>& movement);
  void logTimeout();
  void logBlockEnd(const std::optional<Effective>& effective);
  void closeLog();

  RoundSetup setup_;
  std::vector<Block> blocks_;
  Phase phase_ = Phase::kReady;
  int block_ = 0;
  int trial_ = 0;
  int target_id_ = 0;
  float appeared_s_ = 0.0F;
  Vec3 center_m_ = Vec3::Zero();
  /// Where the present movement began: the selection of the trial before.
  std::optional<Selection> began_;
  MovementSums sums_;
  Tally tally_;
  Outcome last_outcome_ = Outcome::kNone;
  Vec3 last_center_m_ = Vec3::Zero();
  double last_width_m_ = 0.0;
  float last_outcome_s_ = 0.0F;
};

}  // namespace sim2vr::games::pointing

// SPDX-License-Identifier: Apache-2.0
// One round: things that come, blades and head that meet them, and what that counts.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "beats/level.hpp"
#include "beats/settings.hpp"
#include "beats/swing.hpp"
#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/math.hpp"
#include "sim2vr/rl/episode_logger.hpp"
#include "sim2vr/rl/sound.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/component.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::beats {

// What a round has come to so far.

enum class Fault { kWrongHand, kWrongDirection, kMine, kWall, kMiss };

class Tally {
 public:
  explicit Tally(bool multiply) : multiply_(multiply) {}

  void addSlice(int points, double speed_mps, double angle_deg);
  /// Points of a slice that were not known when it was made.
  void addPoints(int points) { score_ += points; }
  void addFault(Fault fault);
  /// The head was in a wall for that long; `errors_per_second` counts on top of the wall itself.
  void addWallTime(double seconds, double errors_per_second);
  void addAvoidedMine() { ++mines_avoided_; }
  void addAvoidedWall() { ++walls_avoided_; }

  int score() const { return score_; }
  int slices() const { return slices_; }
  int count(Fault fault) const { return faults_.at(static_cast<std::size_t>(fault)); }
  int misses() const { return count(Fault::kMiss); }
  /// All faults but misses, and what was counted for time in walls.
  double errors() const;
  int minesAvoided() const { return mines_avoided_; }
  int wallsAvoided() const { return walls_avoided_; }
  double wall_s() const { return wall_s_; }
  int combo() const { return combo_; }
  int longestCombo() const { return longest_combo_; }
  int factor() const { return multiply_ ? multiplier_.factor() : 1; }
  /// 0 to 1; half at the start.
  double energy() const { return energy_; }
  /// Over the correct slices; 0 without any.
  double meanSpeed_mps() const { return slices_ == 0 ? 0.0 : speed_sum_mps_ / slices_; }
  double meanAngle_deg() const { return slices_ == 0 ? 0.0 : angle_sum_deg_ / slices_; }

  void fields(Archive& archive);

 private:
  void addEnergy(double change);

  bool multiply_;
  int score_ = 0;
  int slices_ = 0;
  std::array<int, 5> faults_{};
  int mines_avoided_ = 0;
  int walls_avoided_ = 0;
  double wall_s_ = 0.0;
  double wall_time_errors_ = 0.0;
  int combo_ = 0;
  int longest_combo_ = 0;
  Multiplier multiplier_;
  double energy_ = 0.5;
  double speed_sum_mps_ = 0.0;
  double angle_sum_deg_ = 0.0;
};

// What the player feels and hears.

class Feedback {
 public:
  /// Makes the game's action set, before the rig attaches all of them. Both outlive it.
  Feedback(xr::Session& session, rl::SoundLog& sounds);

  void slice(Hand hand, const Vec3& place_m);
  void wrongCut(Hand hand, const Vec3& place_m);
  void mine(Hand hand, const Vec3& place_m);
  /// The head comes into a wall: both hands feel it.
  void wall(const Vec3& place_m);
  void miss(const Vec3& place_m);

 private:
  struct Pulse {
    int milliseconds;
    float amplitude;
  };
  void vibrate(Hand hand, const Pulse& pulse);
  void play(std::string_view sound, const Vec3& place_m);

  xr::Session* session_;
  rl::SoundLog* sounds_;
  const xr::Action* vibration_;
};

// Which of a level's boxes, mines or walls are done with.

class Track {
 public:
  explicit Track(std::size_t count) : done_(count, 0) {}

  void finish(std::size_t i) {
    done_.at(i) = 1;
    while (first_ < done_.size() && done_[first_] != 0) ++first_;
  }

  /// Indices of `things`, which are in order of time, that are not done and not later than
  /// `latest_s`.
  template <class T>
  std::vector<std::size_t> out(const std::vector<T>& things, double latest_s) const {
    std::vector<std::size_t> indices;
    for (std::size_t i = first_; i < done_.size() && things[i].time_s <= latest_s; ++i) {
      if (done_[i] == 0) indices.push_back(i);
    }
    return indices;
  }

  void fields(Archive& archive) {
    const std::size_t count = done_.size();
    archive.field("done", done_);
    archive.field("first", first_);
    if (done_.size() != count || first_ > count) {
      throw EngineError("saved state: a level with another number of things");
    }
  }

 private:
  std::vector<std::uint8_t> done_;
  /// None before it is left.
  std::uint64_t first_ = 0;
};

struct RoundSetup {
  Settings settings;
  std::shared_ptr<const Level> level;
  rl::XrRig rig;
  std::uint32_t seed = 0;
  /// Null when no logs are written.
  rl::EpisodeLogger* logger = nullptr;
};

class Round : public scene::Component {
 public:
  enum class Phase : std::uint8_t { kReady, kPlay, kDone };

  Round(RoundSetup setup, const Feedback& feedback);

  std::string_view typeName() const override { return "beats.Round"; }
  void Update() override;
  void fields(Archive& archive) override;

  Phase phase() const { return phase_; }
  const Settings& settings() const { return setup_.settings; }
  const Layout& layout() const { return setup_.settings.layout; }
  const Level& level() const { return *setup_.level; }
  const Tally& tally() const { return tally_; }
  const Saber& saber(Hand hand) const { return sabers_.at(static_cast<std::size_t>(hand)); }
  const scene::GameObject& head() const { return *setup_.rig.camera; }
  /// Where the head was in the first frame.
  const Vec3& origin_m() const { return origin_m_; }
  /// Since the level's first beat.
  double time_s() const { return time_s_; }
  /// Since the frame before.
  double frame_s() const { return frame_s_; }

  // Those that have appeared and are neither cut nor gone, by index in the level, in order of time.
  std::vector<std::size_t> boxesOut() const { return boxes_.out(level().boxes, appearedBy()); }
  std::vector<std::size_t> minesOut() const { return mines_.out(level().mines, appearedBy()); }
  std::vector<std::size_t> wallsOut() const { return walls_.out(level().walls, appearedBy()); }

  // Where they are now, world axes.
  Block box(std::size_t i) const;
  Block mine(std::size_t i) const;
  Block wall(std::size_t i) const;

  /// What has just gone to pieces, for show.
  struct Burst {
    enum class Of : std::uint8_t { kLeftBox, kRightBox, kMine };
    double time_s = 0.0;
    Vec3 place_m = Vec3::Zero();
    Of of = Of::kMine;
    void fields(Archive& archive);
  };
  static constexpr double kBurst_s = 0.25;
  const std::vector<Burst>& bursts() const { return bursts_; }

 private:
  /// A blade that meets something.
  struct Touch {
    double time_s;
    Hand hand;
    Vec3 place_m;
    /// Of the blade where it is nearest to the thing's middle, across the blade.
    Vec3 velocity_mps;
  };
  struct Event {
    enum class Kind : std::uint8_t {
      kCut,
      kMiss,
      kMineTouched,
      kMineAvoided,
      kWallTouched,
      kWallGone
    };
    double time_s;
    Kind kind;
    /// In the level's list.
    std::size_t index;
    Vec3 place_m;
    std::optional<Touch> touch = std::nullopt;
  };

  void begin();
  void play();
  void finish();
  std::vector<Event> eventsOfFrame() const;
  void addBoxEvent(std::size_t i, std::vector<Event>& events) const;
  /// The earliest by the box's own blade that cuts it correctly, where more than the box counts.
  std::optional<Touch> wideTouch(std::size_t i) const;
  bool isCorrect(const Box& box, const Touch& touch) const;
  void addMineEvent(std::size_t i, std::vector<Event>& events) const;
  void addWallEvent(std::size_t i, std::vector<Event>& events) const;
  /// The earliest by either blade, fast enough, of what is at `now` and has the time `thing_s` in
  /// the level.
  std::optional<Touch> firstTouch(const Block& now, double reach_m, double thing_s,
                                  double min_speed_mps) const;
  std::optional<Touch> touchBy(const Saber& saber, const Block& now, double reach_m,
                               double thing_s) const;
  void apply(const Event& event);
  void applyCut(const Event& event);
  /// Once a frame, after the sabers.
  void followSwings();
  /// Gives the points of cuts whose swing is over.
  void followCuts();
  void closeCut(const OpenCut& cut);
  bool headInWall() const;
  bool isOver() const;
  /// Things of that time or earlier have appeared.
  double appearedBy() const { return time_s_ + level().approach_s; }
  /// Of what comes, over the last frame.
  Vec3 driftOfFrame_m() const;
  /// A level time within the last frame, 0 at its start and 1 at its end.
  double shareOf(double time_s) const;
  Block placed(Block block) const;
  void openLog();
  void logState();
  /// What has appeared since `after_s`, a level time of things.
  void logSpawns(double after_s);
  void logEvent(const Event& event, const char* what, const std::string& more = {});
  /// With how much later than its time the box was cut, and the angle to what it demands.
  void logCut(const Event& event, const char* what, std::optional<double> angle_deg);
  void logPoints(const OpenCut& cut);
  void closeLog();

  RoundSetup setup_;
  Feedback feedback_;
  Tally tally_;
  std::array<Saber, 2> sabers_;
  /// With points for the swing only.
  std::array<Swing, 2> swings_;
  std::vector<OpenCut> open_cuts_;
  Track boxes_, mines_, walls_;
  /// Walls that the head has been in.
  std::vector<std::uint8_t> walls_touched_;
  Phase phase_ = Phase::kReady;
  std::int64_t start_ns_ = 0;
  double time_s_ = 0.0;
  double frame_s_ = 0.0;
  Vec3 origin_m_ = Vec3::Zero();
  Pose head_;
  Pose last_head_;
  std::vector<Burst> bursts_;
};

// What the player has been able to see. Teachers and shaped rewards may know that and no more.

class Sight {
 public:
  /// `aspect`: width / height of the headset image. The round outlives it.
  Sight(const Round& round, double aspect);

  /// At the end of every frame: notices what has come into view. Nothing hides anything.
  void look();

  // Those that are out and have been in view, by index in the level, in order of time.
  std::vector<std::size_t> boxes() const { return seen(round_->boxesOut(), boxes_); }
  std::vector<std::size_t> boxes(Hand hand) const;
  std::vector<std::size_t> mines() const { return seen(round_->minesOut(), mines_); }
  std::vector<std::size_t> walls() const { return seen(round_->wallsOut(), walls_); }
  /// From the hand's blade to the surface of its next box.
  std::optional<double> bladeToBox_m(Hand hand) const;

  void fields(Archive& archive);

 private:
  using Flags = std::vector<std::uint8_t>;
  static std::vector<std::size_t> seen(std::vector<std::size_t> out, const Flags& flags);

  const Round* round_;
  double aspect_;
  Flags boxes_, mines_, walls_;
};

}  // namespace sim2vr::games::beats

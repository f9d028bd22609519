// SPDX-License-Identifier: Apache-2.0
// One round: things that come, blades and head that meet them, and what that counts.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "beats/feedback.hpp"
#include "beats/saber.hpp"
#include "beats/settings.hpp"
#include "beats/swing.hpp"
#include "beats/tally.hpp"
#include "beats/track.hpp"
#include "sim2vr/rl/episode_logger.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/component.hpp"

namespace sim2vr::games::beats {

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
  struct Touch;  // round_event.hpp
  struct Event;

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

}  // namespace sim2vr::games::beats

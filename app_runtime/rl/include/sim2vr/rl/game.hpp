// SPDX-License-Identifier: Apache-2.0
// What a game gives the runtime: a Game that survives rounds and fills an empty scene for each of
// them, and the round's RLEnv, which turns play into reward, end and time feature (SIM2VR's RLEnv).
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/math.hpp"
#include "sim2vr/core/options.hpp"
#include "sim2vr/rl/game_facts.hpp"
#include "sim2vr/scene/component.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::xr {
class Session;
}
namespace sim2vr::physics {
class PhysicsWorld;
}

namespace sim2vr::rl {

class EpisodeLogger;
class SoundLog;

/// Base of a game's learning interface; one per round, on an object of the scene. It runs after the
/// game's own components, so that it sees the frame's final state.
class RLEnv : public scene::Component {
 public:
  static constexpr int kExecutionOrder = 5;
  int executionOrder() const override { return kExecutionOrder; }

  /// Begins the episode: called once, before the first frame's Update; a new episode gets a new
  /// scene.
  virtual void beginRound() {}
  /// Names what log() has, with logColumn and logTerm: called once, before the first frame and
  /// before the first one after a load.
  virtual void declareLog() {}
  /// The reward of this frame.
  virtual double calculateReward() = 0;
  /// Whether the round is over after this frame.
  virtual bool isOver() const = 0;
  /// Position in the round as the policy sees it, from -1 (start) to 1 (end).
  virtual float timeFeature() const = 0;
  /// Writes the numbers named by Game::privilegedNames(), one for each, as they are after the
  /// user step's last frame. Of what the head camera has to find, only what it shows or has shown
  /// since it came into being may be written.
  virtual void fillPrivileged(std::span<float> values) const;

  float reward() const { return reward_; }
  bool finished() const { return finished_; }
  /// Named numbers of the episode so far, and of its latest user step (logTerm), for training logs
  /// and evaluation; the same names for every round. One that a round has not is NaN, and is left
  /// out of what clients get.
  const std::map<std::string, double>& log() const { return log_; }

  /// The runtime says that a user step of so many frames begins: a reward term that flows all the
  /// time, other than one for an event, is divided by it, so that a user step is worth the same
  /// whatever the tracking rate.
  void beginStep(int frames);
  int framesPerStep() const { return frames_per_step_; }

  void Start() final;
  void Update() final;
  /// Overriding classes call this one first.
  void fields(Archive& archive) override;

 protected:
  /// Logs a number under this name after every frame's calculateReward.
  void logColumn(const std::string& name, std::function<double()> value);
  /// Logs a part of the reward: the sum over the user step's frames under `name`, and over the
  /// round's under `name` + kSumSuffix. NaN: the round has no such part.
  void logTerm(const std::string& name, std::function<double()> value);

 private:
  /// Where a number of log_ is; of a term also its sum over the round.
  struct Column {
    double* value;
    double* sum;
    std::function<double()> now;
  };

  void updateLog();

  float reward_ = 0.0F;
  bool finished_ = false;
  std::map<std::string, double> log_;
  std::vector<Column> columns_;
  int frames_per_step_ = 1;
  /// No frame of the user step has been run.
  bool step_begins_ = true;
};

/// What Game::build may use. The references outlive the scene's content.
struct GameContext {
  scene::Scene& scene;
  xr::Session& xr;
  physics::PhysicsWorld& physics;
  /// Fixes the round together with the options and the input.
  std::uint32_t seed = 0;
  /// Null when no logs are written.
  EpisodeLogger* logger = nullptr;
  /// Where the round's sounds go (sound.hpp).
  SoundLog& sounds;
};

/// One game of one app; lives as long as the app.
class Game {
 public:
  Game() = default;
  virtual ~Game() = default;
  Game(const Game&) = delete;
  Game& operator=(const Game&) = delete;

  virtual std::string_view name() const = 0;
  virtual std::string_view description() const = 0;
  /// What the harness shows and measures of the game. Without: its rewards alone.
  virtual GameFacts facts() const { return {}; }

  /// Reads the options of the rounds that follow; every option has a default. Throws
  /// InvalidArgument and leaves the settings as they were. The caller then checks
  /// options.expectAllRead().
  virtual void configure(Options& options) = 0;

  /// Populates the EMPTY scene for a new round and returns its environment. The scene holds the
  /// head camera (kHeadCameraPath in xr_rig.hpp) and may hold kThirdPersonCameraPath and
  /// kSpectatorCameraPath; a scene without gets them from room_looks.hpp.
  virtual RLEnv& build(GameContext& context) = 0;

  /// How the head shall be held in the round that `seed` and the present options would start: pitch
  /// in degrees, up positive. Asked before the round, answered by the player's body; none: as the
  /// player likes.
  virtual std::optional<double> headRequest(std::uint32_t seed) const;

  /// What comes when in the round that `seed` and the present options would start, for a picture
  /// of it: a JSON object with `name`, `length_s`, `lanes` (names, bottom up), `beats_s` (lines of
  /// a grid), `items`, `facts` (texts and numbers in order) and `level` (an object, as the game has
  /// it, for those who play the level elsewhere). An item has `time_s`, `lane`,
  /// `shape` ("box", "disc", "dot" or "bar"; a bar has `duration_s` and `lanes`, upwards from
  /// `lane`), `color` ("#rrggbb"), `kind`, and may have `arrow_deg` (counter-clockwise from right)
  /// and `marked`. Empty: nothing is known before it is played.
  virtual std::string timelineJson(std::uint32_t seed) const;

  /// Names, unit last, of the numbers behind the picture that a teacher learns from (RLEnv's
  /// fillPrivileged); the same for every round. Those that begin with "aid." are not for its
  /// observation but for its reward and its start. None: the game does not help teachers.
  virtual const std::vector<std::string>& privilegedNames() const;

  /// What survives rounds (adaptive curricula). Settings from configure() are not part of it.
  virtual void fields(Archive&) {}
};

/// A line of the registry in games/.
struct GameEntry {
  std::string name;
  std::string description;
  std::unique_ptr<Game> (*create)();
};

}  // namespace sim2vr::rl

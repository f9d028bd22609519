// One VR application in lockstep: it moves only when it is told to, by one frame at a time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/core/clock.hpp"
#include "sim2vr/render/renderer.hpp"
#include "sim2vr/rl/game.hpp"
#include "sim2vr/rl/sound.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::runtime {

struct AppSettings {
  /// Name in games::registry().
  std::string game = "whacamole";
  /// The game's options, a JSON object; unknown ones are refused.
  std::string options_json = "{}";
  render::ImageSize headset_size{120, 80};
  TimeSettings time;
  /// Root of the episode logs; empty: none are written.
  std::filesystem::path log_dir;
};

/// Input of one frame.
struct FrameInput {
  /// Frame time on the game clock, ns. Must not go backwards.
  std::int64_t time_ns = 0;
  /// Poses in STAGE space, OpenXR's frame (xr/frames.hpp converts from the app's).
  xr::DeviceState devices;
};

/// What the frames of a step or reset asked the user's devices for, in order.
struct Events {
  std::vector<xr::HapticPulse> haptics;
  std::vector<rl::SoundEvent> sounds;
};

/// What a step came to, without the game's named numbers.
struct Outcome {
  float reward = 0.0F;
  bool finished = false;
  float time_feature = 0.0F;
};

struct StepResult {
  float reward = 0.0F;
  bool finished = false;
  float time_feature = 0.0F;
  std::map<std::string, double> log;
  Events events;
};

/// Which camera renderView uses.
enum class View : std::uint8_t { headset, recorder, spectator };
/// "headset", "recorder" or "spectator"; throws InvalidArgument("view") for another word.
View viewFromName(std::string_view name);

/// Where a round begins.
struct RoundStart {
  std::uint32_t seed = 0;
  /// Merged into the game's options for this and later rounds.
  std::string_view options_json = "{}";
  /// Time of the round's first frame, ns. Not 0 where a clock runs on over rounds, as in recordings
  /// of the reference: fixed steps lie on the absolute grid, and binary32 times round differently.
  std::int64_t time_ns = 0;
};

/// Life of a frame at t_n: every fixed step up to t_n (FixedUpdate, overlaps and trigger callbacks,
/// with the poses of the previous frame), then the poses of this frame, the game's Update, the
/// reward, LateUpdate, and the headset image.
///
/// Not thread-safe; different apps may run on different threads, also when they share a renderer.
class App {
 public:
  /// `image`: where the headset image goes, height x width x 4 bytes that outlive the app; empty:
  /// memory of its own. Throws InvalidArgument for an unknown game or option and an unusable image
  /// size.
  App(AppSettings settings, std::shared_ptr<render::Renderer> renderer,
      std::span<std::uint8_t> image = {});
  ~App();
  App(const App&) = delete;
  App& operator=(const App&) = delete;

  const AppSettings& settings() const { return settings_; }
  const render::Renderer& renderer() const { return *renderer_; }

  /// Starts a round in a fresh scene, runs its first frame and renders it. When the options or
  /// poses are refused, the running round goes on as if nothing had been asked.
  StepResult reset(const RoundStart& start, const xr::DeviceState& devices);

  /// One user step: runs the frames in turn and renders the last one. The reward is their sum; when
  /// the round ends before the last frame, the rest are not run. Throws StateError before the first
  /// reset and after the end of the round; InvalidArgument for no frames at all, poses that are not
  /// finite or not normalised, and a time before the previous frame's, and then nothing has moved.
  StepResult step(std::span<const FrameInput> frames);
  StepResult step(const FrameInput& frame) { return step(std::span(&frame, 1)); }

  // What reset and step are made of, for callers that draw the pictures of many apps together
  // (AppBatch): the same without a picture.
  Outcome begin(const RoundStart& start, const xr::DeviceState& devices);
  Outcome advance(std::span<const FrameInput> frames);
  /// The game's named numbers after the last frame. Throws StateError before the first reset.
  const std::map<std::string, double>& log();
  /// What the latest begin or advance asked the devices for; empty before the first reset.
  const Events& events() const { return events_; }
  /// The head's pitch, degrees up, that the game wishes for in the round that `start` would begin
  /// (rl::Game::headRequest). Starts nothing. Throws InvalidArgument for options that are refused.
  std::optional<double> headRequest(const RoundStart& start) const;
  /// Names of what fillPrivileged writes; none for a game that does not help teachers.
  const std::vector<std::string>& privilegedNames() const { return game_->privilegedNames(); }
  /// The game's numbers behind the picture after the last frame (rl::RLEnv::fillPrivileged). Throws
  /// StateError before the first reset.
  void fillPrivileged(std::span<float> values);
  /// What draws the last frame's headset image into the app's memory for it.
  render::ViewRequest headsetView() {
    return viewRequest(View::headset, settings_.headset_size, image_);
  }

  /// The headset image of the last frame: height x width x 4 bytes (renderer.hpp). The address
  /// stays the same for the app's life; reset, step and load overwrite it. Black before the first
  /// reset.
  std::span<const std::uint8_t> image() const { return image_; }

  /// The last frame in another size or from another camera, into height x width x 4 bytes. Throws
  /// StateError before the first reset, InvalidArgument for a view that the game does not offer.
  void renderView(View view, render::ImageSize size, std::span<std::uint8_t> rgba);

  /// The whole state, mid-round included, for an app with the same game. Throws StateError before
  /// the first reset.
  std::string save();
  /// Goes on from saved bytes. Throws EngineError for damaged ones or another game's; the app then
  /// has no round and needs a reset.
  void load(const std::string& state);
  /// Hash of what save() would write.
  std::uint64_t stateHash();

 private:
  struct Round;

  void beginRound(std::uint32_t seed, std::int64_t start_ns, rl::EpisodeLogger* logger);
  Round& round(std::string_view call);
  void runFrame(std::int64_t time_ns, const xr::DeviceState& devices);
  Outcome outcome(float reward);
  StepResult shown(const Outcome& outcome);
  render::ViewRequest viewRequest(View view, render::ImageSize size, std::span<std::uint8_t> rgba);

  void fields(Archive& archive);

  AppSettings settings_;
  std::shared_ptr<render::Renderer> renderer_;
  std::unique_ptr<rl::Game> game_;
  std::unique_ptr<rl::EpisodeLogger> logger_;
  std::uint32_t seed_ = 0;
  Events events_;
  std::vector<std::uint8_t> own_image_;
  std::span<std::uint8_t> image_;
  std::unique_ptr<Round> round_;
};

}  // namespace sim2vr::runtime

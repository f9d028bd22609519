// SPDX-License-Identifier: Apache-2.0
// The seam below server and batch: whatever moves in lockstep, by one frame at a time, can be
// played through it. runtime::App is the one that plays the games of games::registry().
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/core/clock.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/render/renderer.hpp"
#include "sim2vr/render/shown.hpp"
#include "sim2vr/rl/sound.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::runtime {

struct AppSettings {
  /// Name in games::registry().
  std::string game = "whacamole";
  /// The game's options, a JSON object; unknown ones are refused.
  std::string options_json = "{}";
  /// Of one eye's image.
  render::ImageSize headset_size{120, 80};
  /// 1: a picture from between the eyes; 2: one of each, which needs Capability::two_eyes.
  int eyes = 1;
  /// Distance between the pupils, metres.
  float ipd_m = 0.064F;
  TimeSettings time;
  /// Root of the episode logs; empty: none are written.
  std::filesystem::path log_dir;

  /// eyes x height x width x 4.
  std::size_t imageBytes() const {
    return static_cast<std::size_t>(eyes) * headset_size.pixels() * 4;
  }
  /// Throws InvalidArgument for an unusable image size, number of eyes or time. What concerns the
  /// game is its app's to check.
  void validate() const;
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

/// What a step came to, without the app's named numbers.
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

/// What an app may be able to do beyond playing one frame at a time.
enum class Capability : std::uint8_t {
  save,             // save, load and stateHash
  views,            // renderView
  frames,           // several frames in a step, of which any one is drawn
  inputs,           // triggers, thumbsticks and buttons of the controllers
  left_controller,  // a left controller
  haptics,          // vibrations of the controllers come back
  sounds,           // sounds come back
  head_request,     // headRequest
  two_eyes,         // AppSettings::eyes = 2
  privileged,       // fillPrivileged
  scene,            // shown
  observers,        // renderFrom
};
using Capabilities = std::set<Capability>;

/// As people and clients write it: "save", "left_controller".
std::string_view capabilityName(Capability capability);
std::vector<std::string> capabilityNames(const Capabilities& capabilities);

/// Something was asked of an app that it cannot do.
class Unsupported : public EngineError {
 public:
  explicit Unsupported(Capability capability);
  Capability capability() const { return capability_; }

 private:
  Capability capability_;
};

/// A step or reset ended before its next frame because that was requested
/// (LockstepApp::stopOn).
class Interrupted : public StateError {
 public:
  using StateError::StateError;
};

/// Index of the last frame of a step, whatever their number.
inline constexpr int kLastFrame = -1;

/// An app that moves only when it is stepped. Not thread-safe; different apps may run on different
/// threads, also when they share a renderer.
///
/// A step has two halves, so that a batch of apps can draw their pictures together and
/// a user with a delay can see an earlier frame than the last one: startStep runs the frames up to
/// the one to be drawn, finishStep the rest.
class LockstepApp {
 public:
  virtual ~LockstepApp() = default;
  LockstepApp(const LockstepApp&) = delete;
  LockstepApp& operator=(const LockstepApp&) = delete;

  virtual const AppSettings& settings() const = 0;
  /// The same for the app's life.
  virtual const Capabilities& capabilities() const = 0;
  bool can(Capability capability) const { return capabilities().contains(capability); }
  /// What draws the pictures, for people.
  virtual std::string rendererDescription() const = 0;

  // --- Playing. What the app cannot take (a left controller, inputs that are not at rest, several
  // frames) is refused as Unsupported, and then nothing has moved.

  /// Starts a round and runs its first frame. When options or poses are refused, the running round
  /// goes on as if nothing had been asked. Throws InvalidArgument for those.
  Outcome begin(const RoundStart& start, const xr::DeviceState& devices);

  /// Runs frames 0 to `drawn` (kLastFrame: all) of a user step, fewer when the round ends before.
  /// Throws StateError before the first reset, after the end of the round and in the middle of a
  /// step; InvalidArgument for no frames, an impossible `drawn`, poses that are not finite or not
  /// normalised and a time before the previous frame's, and then nothing has moved.
  void startStep(std::span<const FrameInput> frames, int drawn = kLastFrame);
  /// Runs the frames that are left. The reward is the sum over all frames of the step; when the
  /// round ends before the last one, the rest are not run. Throws StateError without startStep.
  virtual Outcome finishStep() = 0;

  /// As soon as `stop` is true, begin, startStep and finishStep throw Interrupted
  /// instead of running their next frame: thousands of frames may be under way when a process is
  /// asked to end. What the app is worth then is no user step's. Null: never. Outlives the app.
  void stopOn(const std::atomic<bool>* stop) { stop_ = stop; }

  // --- Pictures.

  /// The headset image of the latest frame that was to be drawn: eyes x height x width x 4 bytes
  /// (render/renderer.hpp), the left eye first. The address stays the same for the app's life.
  /// Black before the first picture.
  virtual std::span<const std::uint8_t> image() const = 0;
  /// Adds what a renderer has to draw into image() for the present frame. An app that draws for
  /// itself has done so at the end of begin, startStep and load, and adds nothing.
  virtual void addViews(std::vector<render::ViewRequest>&) {}
  /// Adds what else the headset sees of the present frame, through another frustum. An app that
  /// draws for itself adds nothing.
  virtual void addWindow(std::vector<render::ViewRequest>&, const render::EyeView&,
                         render::ImageSize, std::span<std::uint8_t> /*rgba*/,
                         std::span<float> /*depth_m*/) {}
  /// Draws image() anew with the app's own renderer. Throws StateError before the first reset.
  virtual void draw() {}

  // --- Whole steps, for a single app.

  /// begin and draw.
  StepResult reset(const RoundStart& start, const xr::DeviceState& devices);
  /// startStep, draw and finishStep.
  StepResult step(std::span<const FrameInput> frames, int drawn = kLastFrame);
  StepResult step(const FrameInput& frame) { return step(std::span(&frame, 1)); }

  // --- What the latest frame left.

  /// The app's named numbers, the same names for every round. Throws StateError before the first
  /// reset.
  virtual const std::map<std::string, double>& log() const = 0;
  /// What the latest begin or finishStep asked the devices for; empty before the first reset.
  virtual const Events& events() const = 0;

  // --- What needs a capability. Without it: Unsupported.

  /// Names of what fillPrivileged writes; none for an app that does not help teachers.
  virtual const std::vector<std::string>& privilegedNames() const;
  /// The numbers behind the picture after the last frame (rl::RLEnv::fillPrivileged). Throws
  /// StateError before the first reset.
  virtual void fillPrivileged(std::span<float> values) const;
  /// The head's pitch, degrees up, that the app wishes for in the round that `start` would begin;
  /// none: no wish. Starts nothing. Throws InvalidArgument for options that are refused.
  virtual std::optional<double> headRequest(const RoundStart& start) const;
  /// The latest frame in another size or from another camera, into height x width x 4 bytes; the
  /// headset's from between the eyes. Throws StateError before the first reset, InvalidArgument for
  /// a view that the app does not offer.
  virtual void renderView(View view, render::ImageSize size, std::span<std::uint8_t> rgba);
  /// The latest frame as the headset's camera would show it from `app_T_observer`, without what
  /// stands for the player, into height x width x 4 bytes; depth_m: as of render::ViewRequest.
  /// Throws as renderView does.
  virtual void renderFrom(const Pose& app_T_observer, double vertical_fov_deg,
                          render::ImageSize size, std::span<std::uint8_t> rgba,
                          std::span<float> depth_m);
  /// What the latest frame's scene holds and shows. Meshes keep their numbers for the app's life.
  /// Throws StateError before the first reset.
  virtual std::vector<render::Shown> shown();
  /// The mesh of a number that shown() gave. Throws InvalidArgument for another one.
  virtual const render::Mesh& shownMesh(int number) const;
  /// The whole state, mid-round included, for an app with the same settings. Throws StateError
  /// before the first reset.
  virtual std::string save();
  /// Goes on from saved bytes and draws image(). Throws EngineError for damaged ones or another
  /// app's; the app then has no round and needs a reset.
  virtual void load(const std::string& state);
  /// Hash of what save() would write.
  virtual std::uint64_t stateHash();

 protected:
  LockstepApp() = default;
  /// For before each frame of a step.
  void throwIfStopped() const;

 private:
  /// begin, and startStep with the index of a frame, of what the app is able to take.
  virtual Outcome doBegin(const RoundStart& start, const xr::DeviceState& devices) = 0;
  virtual void doStartStep(std::span<const FrameInput> frames, std::size_t drawn) = 0;

  void requireInput(const xr::DeviceState& devices) const;

  const std::atomic<bool>* stop_ = nullptr;
};

/// Makes an app. `renderer` is what it may draw with; `image`: where its headset image goes,
/// settings.imageBytes() that outlive the app, or empty for memory of its own. Throws
/// InvalidArgument for settings that cannot be used and Unsupported for eyes that it has not.
using AppFactory = std::function<std::unique_ptr<LockstepApp>(
    const AppSettings& settings, std::shared_ptr<render::Renderer> renderer,
    std::span<std::uint8_t> image)>;

/// The factory of runtime::App, the app of the registered games.
AppFactory gameApps();

}  // namespace sim2vr::runtime

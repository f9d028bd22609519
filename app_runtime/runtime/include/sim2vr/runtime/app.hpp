// SPDX-License-Identifier: Apache-2.0
// One of the registered games as an app in lockstep.
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

#include "sim2vr/games/registry.hpp"
#include "sim2vr/rl/game.hpp"
#include "sim2vr/runtime/lockstep_app.hpp"

namespace sim2vr::rl {
class EpisodeLogger;
}

namespace sim2vr::runtime {

/// Makes the game that AppSettings::game names; throws InvalidArgument for one it does not know.
using GameMaker = std::function<std::unique_ptr<rl::Game>(std::string_view name)>;

/// Life of a frame at t_n: every fixed step up to t_n (FixedUpdate, overlaps and trigger callbacks,
/// with the poses of the previous frame), then the poses of this frame, the game's Update, the
/// reward, LateUpdate, and the headset image where the frame is drawn.
class App final : public LockstepApp {
 public:
  /// `image`: where the headset image goes, settings.imageBytes() that outlive the app; empty:
  /// memory of its own. Throws InvalidArgument for an unknown game or option and as
  /// AppSettings::validate.
  App(AppSettings settings, std::shared_ptr<render::Renderer> renderer,
      std::span<std::uint8_t> image = {}, GameMaker make_game = games::createGame);
  ~App() override;

  const AppSettings& settings() const override { return settings_; }
  const Capabilities& capabilities() const override { return capabilities_; }
  std::string rendererDescription() const override { return renderer_->description(); }

  Outcome finishStep() override;

  std::span<const std::uint8_t> image() const override { return image_; }
  void addViews(std::vector<render::ViewRequest>& views) override;
  void addWindow(std::vector<render::ViewRequest>& views, const render::EyeView& eye,
                 render::ImageSize size, std::span<std::uint8_t> rgba,
                 std::span<float> depth_m) override;
  void draw() override;

  const std::map<std::string, double>& log() const override;
  const Events& events() const override { return events_; }

  const std::vector<std::string>& privilegedNames() const override {
    return game_->privilegedNames();
  }
  void fillPrivileged(std::span<float> values) const override;
  std::optional<double> headRequest(const RoundStart& start) const override;
  void renderView(View view, render::ImageSize size, std::span<std::uint8_t> rgba) override;
  void renderFrom(const Pose& app_T_observer, double vertical_fov_deg, render::ImageSize size,
                  std::span<std::uint8_t> rgba, std::span<float> depth_m) override;
  std::vector<render::Shown> shown() override;
  const render::Mesh& shownMesh(int number) const override { return meshes_.mesh(number); }
  std::string save() override;
  void load(const std::string& state) override;
  std::uint64_t stateHash() override;

 private:
  struct Round;

  /// A user step that was started: its frames, those that were run, and what they came to.
  struct Step {
    std::vector<FrameInput> frames;
    std::size_t run = 0;
    float reward = 0.0F;
    bool open = false;
  };

  Outcome doBegin(const RoundStart& start, const xr::DeviceState& devices) override;
  void doStartStep(std::span<const FrameInput> frames, std::size_t drawn) override;

  void buildRound(std::uint32_t seed, std::int64_t start_ns, rl::EpisodeLogger* logger);
  Round& round(std::string_view call) const;
  void runFrame(const FrameInput& frame);
  void runFramesTo(std::size_t end);
  Outcome outcome(float reward);
  const render::Camera& camera(View view) const;
  std::span<std::uint8_t> eyeImage(int eye) const;

  void fields(Archive& archive);

  AppSettings settings_;
  std::shared_ptr<render::Renderer> renderer_;
  GameMaker make_game_;
  std::unique_ptr<rl::Game> game_;
  Capabilities capabilities_;
  std::unique_ptr<rl::EpisodeLogger> logger_;
  std::uint32_t seed_ = 0;
  Events events_;
  Step step_;
  std::vector<std::uint8_t> own_image_;
  std::span<std::uint8_t> image_;
  render::MeshNumbers meshes_;
  std::unique_ptr<Round> round_;
};

/// Apps of the games that `make_game` knows; gameApps() without it: of the registered ones.
AppFactory gameApps(GameMaker make_game);

}  // namespace sim2vr::runtime

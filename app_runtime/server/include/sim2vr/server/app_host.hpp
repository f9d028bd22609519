// SPDX-License-Identifier: Apache-2.0
// Makes the apps of the sessions from the command line's settings and the clients' wishes.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "sim2vr/games/registry.hpp"
#include "sim2vr/runtime/lockstep_app.hpp"
#include "sim2vr/runtime/recorder.hpp"
#include "sim2vr/server/protocol1.hpp"

namespace sim2vr::server {

struct HostSettings {
  /// Makes the apps.
  runtime::AppFactory make_app = runtime::gameApps();
  /// What a game of theirs publishes, a JSON object (rl/game_facts.hpp); none: nothing.
  std::function<std::string(std::string_view game)> facts_json = games::gameFactsJson;
  /// What a client does not ask for.
  runtime::AppSettings app;
  std::string renderer = "automatic";
  /// Pictures of every frame.
  std::optional<runtime::RecorderSettings> recorder;

  /// Seed of every round of protocol 1; 0: seeds are drawn.
  std::uint32_t fixed_seed = 0;
  /// Of protocol 1, for clients that do not say.
  protocol1::FrameTime frame_time = protocol1::FrameTime::next;
  protocol1::ClockOrigin clock = protocol1::ClockOrigin::absolute;

  /// Frames are paced against the wall clock, for people who watch.
  bool realtime = false;
  /// Game seconds per wall-clock second then; 0: the handshake's timeScale, else 1.
  double time_scale = 0.0;

  /// Apps of one message run on this many threads.
  int threads = 1;
  /// Clients are on this machine: they may have shared memory and name folders for logs.
  bool local = true;
};

/// One app and its recorder.
class HostedApp {
 public:
  HostedApp(std::unique_ptr<runtime::LockstepApp> app,
            std::optional<runtime::RecorderSettings> recorder);

  runtime::LockstepApp& app() { return *app_; }
  runtime::StepResult reset(const runtime::RoundStart& start, const xr::DeviceState& devices);
  runtime::StepResult step(std::span<const runtime::FrameInput> frames,
                           int drawn = runtime::kLastFrame);

 private:
  void record();

  std::unique_ptr<runtime::LockstepApp> app_;
  std::unique_ptr<runtime::Recorder> recorder_;
};

class AppHost {
 public:
  explicit AppHost(HostSettings settings);

  const HostSettings& settings() const { return settings_; }

  /// Apps with the same settings. Those of the first session write their logs and pictures to the
  /// folders of the settings, those of later ones to session001, session002 ... below them; each of
  /// several apps has a folder app000, app001 ... of its own. Throws as the factory does.
  std::vector<std::unique_ptr<HostedApp>> makeApps(const runtime::AppSettings& settings,
                                                   const std::string& renderer,
                                                   std::uint32_t count);

  /// The apps made from now on are interrupted in the middle of a step when `stop` becomes true
  /// (runtime::LockstepApp::stopOn).
  void stopOn(const std::atomic<bool>* stop) { stop_ = stop; }

  /// The apps made from now on are another session's.
  void endSession() { ++session_; }

  /// For worker `worker` of settings().threads.
  std::shared_ptr<render::Renderer> renderer(const std::string& kind, int worker = 0);

  /// Seed of the next round of protocol 1.
  std::uint32_t nextSeed();

 private:
  HostSettings settings_;
  std::map<std::pair<std::string, int>, std::shared_ptr<render::Renderer>> renderers_;
  int session_ = 0;
  const std::atomic<bool>* stop_ = nullptr;
  std::uint64_t drawn_seeds_ = 0;
  std::uint64_t entropy_ = 0;
};

}  // namespace sim2vr::server

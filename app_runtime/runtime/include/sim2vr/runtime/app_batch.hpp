// SPDX-License-Identifier: Apache-2.0
// Many apps of one kind, stepped together on a pool of threads.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "sim2vr/runtime/lockstep_app.hpp"
#include "sim2vr/runtime/thread_pool.hpp"

namespace sim2vr::runtime {

struct BatchSettings {
  /// Of every app; its log_dir is not used.
  AppSettings app;
  int apps = 1;
  /// Root of each app's episode logs; none: none are written.
  std::vector<std::filesystem::path> log_dirs;
  /// 1 or more; more than apps are not started.
  int threads = 1;
  render::RendererKind renderer = render::RendererKind::automatic;
  /// What the first threads draw with, from outside; the others make renderers of their own, or
  /// none where the first one does not draw on the CPU (Renderer::drawsOnCpu): it then draws for
  /// all.
  std::vector<std::shared_ptr<render::Renderer>> renderers;
  /// Channels of the pictures (0 red, 1 green, 2 blue, 3 depth) that vision() holds, in this order.
  std::vector<int> vision_channels;
  /// Of fovea(); 0 x 0: none is drawn.
  render::ImageSize fovea_size{0, 0};
  /// Width of a pixel of fovea() at a depth of 1 m.
  float fovea_pixel_m = 0.0F;
  AppFactory make = gameApps();
};

/// N apps. The threads take the apps of a call a few at a time; each draws their pictures together
/// with a renderer of its own, or all wait for the only one, of the GPU, to draw all pictures. What
/// an app does depends on its own input alone, to the bit: not on N, on its index, on the thread
/// that took it or on the number of threads.
///
/// Results lie in arrays of N that keep their address for the batch's life; a call writes the rows
/// of the apps it moves. Not thread-safe.
class AppBatch {
 public:
  /// Throws as the factory, and InvalidArgument for fewer than one app or thread, or a channel that
  /// is none.
  explicit AppBatch(const BatchSettings& settings);

  /// Ends the apps and closes their logs; the arrays of results stay. Nothing may be called then.
  void close() { apps_.clear(); }

  int size() const { return static_cast<int>(apps_.size()); }
  int threads() const { return pool_.threads(); }
  const BatchSettings& settings() const { return settings_; }
  /// For everything that concerns one app only. Throws InvalidArgument("app") outside 0 .. N-1.
  LockstepApp& app(int index);
  /// LockstepApp::load of one app; its rows of images(), vision(), privileged() and logs() are its
  /// own again, the other results stay.
  void load(int index, const std::string& state);

  /// Starts rounds: starts[i] and devices[i] are of app indices[i]. When something is refused, what
  /// the exception names (unless there is only one app) is the first app that refused it; the
  /// others have started.
  void reset(std::span<const int> indices, std::span<const RoundStart> starts,
             std::span<const xr::DeviceState> devices);

  /// One user step of the given apps: frames[i * K] .. frames[i * K + K - 1] are those of app
  /// indices[i], and frame `drawn` of them is drawn. Failures as in reset.
  void step(std::span<const int> indices, std::span<const FrameInput> frames,
            int drawn = kLastFrame);

  /// N x eyes x height x width x 4 bytes (renderer.hpp).
  std::span<const std::uint8_t> images() const { return images_; }
  /// N x (eyes * channels) x height x width bytes, the left eye's channels first: what a policy
  /// looks at, separated by the threads that drew.
  std::span<const std::uint8_t> vision() const { return vision_; }
  /// N x height x width x 4 bytes: a window of the headset's picture around the gaze, drawn with
  /// it.
  std::span<const std::uint8_t> fovea() const { return fovea_; }
  /// N x height x width: its depths, m (ViewRequest::depth_m).
  std::span<const float> foveaDepth() const { return fovea_depth_; }
  /// N x 2: where the next windows are, right and up at a depth of 1 m, m; the caller's to write.
  std::span<float> gaze() { return gaze_; }
  std::span<const float> rewards() const { return rewards_; }
  /// 1 where the round is over.
  std::span<const std::uint8_t> finished() const { return finished_; }
  std::span<const float> timeFeatures() const { return time_features_; }
  /// How many haptic pulses and sounds each app's last step or reset brought, for who wants to know
  /// whether to ask for them (LockstepApp::events).
  std::span<const std::int32_t> hapticCounts() const { return haptic_counts_; }
  std::span<const std::int32_t> soundCounts() const { return sound_counts_; }
  /// Names of the log's numbers, the same for every round of a game; empty before the first reset.
  const std::vector<std::string>& logNames() const { return log_names_; }
  /// N x logNames().size().
  std::span<const double> logs() const { return logs_; }
  /// Names of the privileged numbers; none for a game that does not help teachers.
  const std::vector<std::string>& privilegedNames() const { return apps_.at(0)->privilegedNames(); }
  /// N x privilegedNames().size(), after the last frame of a step.
  std::span<const float> privileged() const { return privileged_; }
  /// The same after the frame that is drawn: what the picture shows. After load they are those of
  /// the last frame.
  std::span<const float> privilegedDrawn() const { return privileged_drawn_; }

 private:
  template <class Work>
  void inPortions(std::size_t count, const Work& work);
  template <class Start, class Finish>
  void run(std::span<const int> indices, const Start& start, const Finish& finish);
  LockstepApp& at(std::span<const int> indices, std::size_t i) {
    return *apps_[static_cast<std::size_t>(indices[i])];
  }
  void addFovea(int index, std::vector<render::ViewRequest>& views);
  void separateChannels(int index);
  void fillPrivileged(int index, std::span<float> rows);
  void countEvents(int index);
  void fillLog(int index);
  void store(int index, const Outcome& outcome);

  BatchSettings settings_;
  ThreadPool pool_;
  std::vector<std::uint8_t> images_;
  std::vector<std::uint8_t> vision_;
  std::vector<std::uint8_t> fovea_;
  std::vector<float> fovea_depth_;
  std::vector<float> gaze_;
  std::vector<float> rewards_;
  std::vector<std::uint8_t> finished_;
  std::vector<float> time_features_;
  std::vector<std::int32_t> haptic_counts_;
  std::vector<std::int32_t> sound_counts_;
  std::vector<std::string> log_names_;
  std::vector<double> logs_;
  std::vector<float> privileged_;
  std::vector<float> privileged_drawn_;
  std::vector<std::shared_ptr<render::Renderer>> renderers_;
  std::vector<std::unique_ptr<LockstepApp>> apps_;
};

}  // namespace sim2vr::runtime

// SPDX-License-Identifier: Apache-2.0
// Pictures of every frame for people, as the reference records them: a third-person view and what
// the headset shows.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "sim2vr/runtime/lockstep_app.hpp"

namespace sim2vr::runtime {

struct RecorderSettings {
  /// Holds envCamera (third person) and mainCamera (headset): folders of image0.png, image1.png ...
  /// or, as videos, envCamera.mp4 and mainCamera.mp4.
  std::filesystem::path folder;
  render::ImageSize size{1280, 960};
  /// Videos instead of pictures, made by the program ffmpeg.
  bool mp4 = false;
  /// Of the videos, frames per second.
  int frame_rate = 20;

  /// Throws InvalidArgument for an unusable image size, and for videos without the program ffmpeg
  /// on PATH.
  void validate() const;
};

/// Writes RGB pictures. Those of an earlier recording in the folder are removed first, other files
/// stay.
class Recorder {
 public:
  /// Throws as validate() does, and EngineError when the folder cannot be written.
  explicit Recorder(RecorderSettings settings);
  /// Closes the videos; a failure is logged.
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Writes the app's last frame. A game without a third-person camera is recorded through the
  /// headset alone. Throws EngineError when a file cannot be written.
  void write(LockstepApp& app);

 private:
  class Sink;
  class PngSink;
  class VideoSink;

  std::unique_ptr<Sink> makeSink(const char* camera) const;
  void writeView(LockstepApp& app, View view, Sink& sink);

  RecorderSettings settings_;
  std::unique_ptr<Sink> third_person_;
  std::unique_ptr<Sink> headset_;
  std::vector<std::uint8_t> rgba_;
  std::vector<std::uint8_t> rgb_;
};

}  // namespace sim2vr::runtime

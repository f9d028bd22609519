#include "sim2vr/runtime/recorder.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdlib>
#include <span>
#include <sstream>
#include <string>
#include <system_error>
#include <utility>

#include "child_process.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/render/image_io.hpp"

namespace sim2vr::runtime {
namespace {

void makeFolder(const std::filesystem::path& folder) {
  std::error_code problem;
  std::filesystem::create_directories(folder, problem);
  if (!problem && ::access(folder.c_str(), W_OK) == 0) return;
  throw EngineError("recorder: cannot write to the folder " + folder.string() +
                    (problem ? ": " + problem.message() : ""));
}

void removeOldPictures(const std::filesystem::path& folder) {
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with("image") && name.ends_with(".png")) std::filesystem::remove(entry.path());
  }
}

bool ffmpegAvailable() {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path == nullptr ? "" : path);
  for (std::string folder; std::getline(folders, folder, ':');) {
    if (::access((folder + "/ffmpeg").c_str(), X_OK) == 0) return true;
  }
  return false;
}

}  // namespace

/// Where the pictures of one camera go.
class Recorder::Sink {
 public:
  virtual ~Sink() = default;
  virtual void write(std::span<const std::uint8_t> rgb) = 0;
};

class Recorder::PngSink final : public Sink {
 public:
  PngSink(std::filesystem::path folder, render::ImageSize size)
      : folder_(std::move(folder)), size_(size) {
    makeFolder(folder_);
    removeOldPictures(folder_);
  }
  void write(std::span<const std::uint8_t> rgb) override {
    render::writePng(folder_ / fmt::format("image{}.png", number_++), size_, rgb, 3);
  }

 private:
  std::filesystem::path folder_;
  render::ImageSize size_;
  std::int64_t number_ = 0;
};

class Recorder::VideoSink final : public Sink {
 public:
  VideoSink(const std::filesystem::path& file, render::ImageSize size, int frame_rate)
      : file_(file), ffmpeg_({"ffmpeg",     "-y",
                              "-loglevel",  "error",
                              "-f",         "rawvideo",
                              "-pix_fmt",   "rgb24",
                              "-s",         fmt::format("{}x{}", size.width, size.height),
                              "-r",         std::to_string(frame_rate),
                              "-i",         "-",
                              "-c:v",       "libx264",
                              "-crf",       "15",
                              "-pix_fmt",   "yuv420p",
                              file.string()}) {}
  ~VideoSink() override {
    const int status = ffmpeg_.finish();
    if (status != 0)
      logger().error("recorder: ffmpeg ended with code {}: {}", status, file_.string());
  }
  void write(std::span<const std::uint8_t> rgb) override {
    if (ffmpeg_.write(rgb)) return;
    throw EngineError("recorder: ffmpeg takes no more pictures for " + file_.string() +
                      "; its message is above");
  }

 private:
  std::filesystem::path file_;
  ChildProcess ffmpeg_;
};

void RecorderSettings::validate() const {
  render::checkImageSize(size);
  if (!mp4) return;
  if (!ffmpegAvailable()) {
    throw InvalidArgument("record-mp4", "no program ffmpeg on PATH",
                          "ffmpeg installed, or pictures instead of videos");
  }
  if (size.width % 2 != 0 || size.height % 2 != 0) {
    throw InvalidArgument("resolution", fmt::format("{}x{}", size.width, size.height),
                          "even numbers of pixels, which videos need");
  }
}

Recorder::Recorder(RecorderSettings settings) : settings_(std::move(settings)) {
  settings_.validate();
  makeFolder(settings_.folder);
  headset_ = makeSink("mainCamera");
  third_person_ = makeSink("envCamera");
  rgba_.resize(4 * settings_.size.pixels());
  rgb_.resize(3 * settings_.size.pixels());
}

Recorder::~Recorder() = default;

std::unique_ptr<Recorder::Sink> Recorder::makeSink(const char* camera) const {
  if (!settings_.mp4) return std::make_unique<PngSink>(settings_.folder / camera, settings_.size);
  return std::make_unique<VideoSink>(settings_.folder / (std::string(camera) + ".mp4"),
                                     settings_.size, settings_.frame_rate);
}

void Recorder::write(LockstepApp& app) {
  writeView(app, View::headset, *headset_);
  writeView(app, View::recorder, *third_person_);
}

void Recorder::writeView(LockstepApp& app, View view, Sink& sink) {
  app.renderView(view, settings_.size, rgba_);
  // Without the depth that the alpha channel carries.
  for (std::size_t i = 0; i < settings_.size.pixels(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) rgb_[3 * i + c] = rgba_[4 * i + c];
  }
  sink.write(rgb_);
}

}  // namespace sim2vr::runtime

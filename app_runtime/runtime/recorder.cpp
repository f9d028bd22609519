// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/runtime/recorder.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <span>
#include <sstream>
#include <string>
#include <system_error>
#include <utility>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/render/image_io.hpp"

namespace sim2vr::runtime {
namespace {

/// A program that reads what we write.
class ChildProcess {
 public:
  /// Starts arguments[0], found on PATH, with its standard input connected to write(). Throws
  /// EngineError when it cannot be started.
  explicit ChildProcess(std::vector<std::string> arguments);
  /// As finish().
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  /// False when the program no longer reads.
  bool write(std::span<const std::uint8_t> bytes);
  /// Closes its input and waits for its end; its exit code, or 128 + the signal that ended it.
  int finish();

 private:
  pid_t pid_ = -1;
  int input_ = -1;
  int status_ = 0;
};

ChildProcess::ChildProcess(std::vector<std::string> arguments) {
  // A socket rather than a pipe: writing to one that is closed need not raise SIGPIPE.
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) {
    throw EngineError(std::string("socketpair: ") + std::strerror(errno));
  }
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_adddup2(&actions, ends[1], STDIN_FILENO);
  // A group of its own: Ctrl-C is for us, and the program then gets to its end through its input.
  posix_spawnattr_t attributes;
  ::posix_spawnattr_init(&attributes);
  ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  const int problem = ::posix_spawnp(&pid_, argv[0], &actions, &attributes, argv.data(), environ);
  ::posix_spawnattr_destroy(&attributes);
  ::posix_spawn_file_actions_destroy(&actions);
  ::close(ends[1]);
  input_ = ends[0];
  if (problem != 0) {
    ::close(input_);
    throw EngineError("cannot start " + arguments[0] + ": " + std::strerror(problem));
  }
}

ChildProcess::~ChildProcess() { finish(); }

bool ChildProcess::write(std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::send(input_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  return true;
}

int ChildProcess::finish() {
  if (pid_ < 0) return status_;
  ::close(input_);
  int status = 0;
  while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
  }
  pid_ = -1;
  status_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return status_;
}

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

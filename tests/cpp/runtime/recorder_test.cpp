// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "own_folder.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/runtime/app.hpp"
#include "sim2vr/runtime/recorder.hpp"
#include "sim2vr/xr/pose_row.hpp"

namespace sim2vr::runtime {
namespace {

xr::DeviceState player() {
  constexpr double kHead[] = {0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0};
  constexpr double kRight[] = {0.15, 1.03, 0.2, 0.0, 0.0, 0.0, 1.0};
  return xr::devicesFromRows(kHead, nullptr, kRight);
}

class RecorderTest : public ::testing::Test {
 protected:
  static std::unique_ptr<App> makeApp(const std::string& game) {
    AppSettings settings;
    settings.game = game;
    auto app =
        std::make_unique<App>(settings, render::Renderer::create(render::RendererKind::null));
    app->reset({.seed = 1}, player());
    return app;
  }

  const sim2vr::testing::OwnFolder own;
  const std::filesystem::path folder = own.path();
};

TEST_F(RecorderTest, NumbersThePicturesOfBothCamerasAndRemovesOldOnes) {
  const auto app = makeApp("whacamole");
  std::filesystem::create_directories(folder / "mainCamera");
  std::ofstream(folder / "mainCamera" / "image7.png") << "old";
  std::ofstream(folder / "mainCamera" / "notes.txt") << "notes";
  Recorder recorder({.folder = folder, .size = {32, 24}});
  recorder.write(*app);
  recorder.write(*app);
  for (const char* camera : {"envCamera", "mainCamera"}) {
    EXPECT_TRUE(exists(folder / camera / "image0.png"));
    EXPECT_TRUE(exists(folder / camera / "image1.png"));
    EXPECT_FALSE(exists(folder / camera / "image2.png"));
  }
  EXPECT_FALSE(exists(folder / "mainCamera" / "image7.png"));
  EXPECT_TRUE(exists(folder / "mainCamera" / "notes.txt"));
}

TEST_F(RecorderTest, AGameWithoutCamerasOfItsOwnIsRecordedFromOutsideToo) {
  const auto app = makeApp("sample");
  Recorder recorder({.folder = folder, .size = {32, 24}});
  recorder.write(*app);
  recorder.write(*app);
  EXPECT_TRUE(exists(folder / "mainCamera" / "image1.png"));
  EXPECT_TRUE(exists(folder / "envCamera" / "image1.png"));
}

TEST_F(RecorderTest, RefusesWhatCannotBeWritten) {
  EXPECT_THROW(Recorder({.folder = folder, .size = {0, 24}}), InvalidArgument);
  std::ofstream(folder / "file") << "in the way";
  EXPECT_THROW(Recorder({.folder = folder / "file" / "x", .size = {32, 24}}), EngineError);
}

/// PATH for the time of a test.
class PathGuard {
 public:
  explicit PathGuard(const std::string& value) : before_(std::getenv("PATH")) {
    ::setenv("PATH", value.c_str(), 1);
  }
  ~PathGuard() { ::setenv("PATH", before_.c_str(), 1); }
  const std::string& before() const { return before_; }

 private:
  std::string before_;
};

TEST_F(RecorderTest, VideosNeedFfmpegAndEvenSizes) {
  const PathGuard path(folder.string());
  const RecorderSettings video{.folder = folder, .size = {32, 24}, .mp4 = true};
  try {
    const Recorder recorder(video);
    FAIL() << "no error";
  } catch (const InvalidArgument& error) {
    EXPECT_STREQ(
        error.what(),
        "record-mp4: got no program ffmpeg on PATH, expected ffmpeg installed, or pictures "
        "instead of videos");
  }
}

/// Stands in for ffmpeg: what it is given goes to the file that it has to make.
void installFakeFfmpeg(const std::filesystem::path& folder, const std::string& body) {
  std::ofstream(folder / "ffmpeg") << "#!/bin/sh\n" << body << "\n";
  ::chmod((folder / "ffmpeg").c_str(), 0755);
}

TEST_F(RecorderTest, GivesFfmpegRawFrames) {
  installFakeFfmpeg(folder, R"(for last; do :; done; echo "$@" > "$last.args"; cat > "$last")");
  const PathGuard path(folder.string() + ":" + std::getenv("PATH"));
  const auto app = makeApp("whacamole");
  EXPECT_THROW(Recorder({.folder = folder, .size = {33, 24}, .mp4 = true}), InvalidArgument);
  {
    Recorder recorder({.folder = folder, .size = {320, 240}, .mp4 = true, .frame_rate = 50});
    for (int i = 0; i < 3; ++i) recorder.write(*app);
  }
  for (const char* video : {"envCamera.mp4", "mainCamera.mp4"}) {
    EXPECT_EQ(file_size(folder / video), 3U * 320 * 240 * 3);
    std::ifstream file((folder / video).string() + ".args");
    std::string arguments;
    std::getline(file, arguments);
    EXPECT_EQ(arguments.find("-y -loglevel error -f rawvideo -pix_fmt rgb24 -s 320x240 -r 50 -i -"),
              0U)
        << arguments;
  }
}

TEST_F(RecorderTest, AnFfmpegThatEndsEarlyIsAnErrorAndNoSignal) {
  installFakeFfmpeg(folder, "exit 3");
  const PathGuard path(folder.string() + ":" + std::getenv("PATH"));
  const auto app = makeApp("whacamole");
  Recorder recorder({.folder = folder, .size = {320, 240}, .mp4 = true});
  EXPECT_THROW(
      {
        for (int i = 0; i < 100; ++i) recorder.write(*app);
      },
      EngineError);
}

}  // namespace
}  // namespace sim2vr::runtime

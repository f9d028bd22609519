// SPDX-License-Identifier: Apache-2.0
#include <iostream>
#include <memory>

#include "outputs.hpp"
#include "sim2vr/core/clock.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/text.hpp"
#include "sim2vr/program/program.hpp"
#include "sim2vr/render/image_io.hpp"
#include "sim2vr/runtime/app.hpp"
#include "sim2vr/xr/pose_row.hpp"
#include "sim2vr/xr/scripted_device.hpp"
#include "summary.hpp"

namespace sim2vr::program {
namespace {

/// A player who stands still: head at 1.17 m, right hand in front of the chest.
xr::DeviceState restingPlayer() {
  constexpr double kHead[] = {0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0};
  constexpr double kRight[] = {0.18, 0.9, 0.25, 0.0, 0.0, 0.0, 1.0};
  return xr::devicesFromRows(kHead, nullptr, kRight);
}

xr::ScriptedDevice readScript(const std::string& path) {
  const std::string text = readTextFile("--script", path, "a readable JSON file");
  try {
    return xr::ScriptedDevice::fromJson(text);
  } catch (const InvalidArgument& error) {
    throw InvalidArgument("--script '" + printable(path) + "', " + error.field(), error.got(),
                          error.expected());
  }
}

xr::ScriptedDevice makePlayer(const std::string& script) {
  if (!script.empty()) return readScript(script);
  return xr::ScriptedDevice({{.time = 0, .state = restingPlayer()}});
}

class FrameWriter {
 public:
  FrameWriter(std::filesystem::path folder, runtime::View view, render::ImageSize size)
      : folder_(std::move(folder)), view_(view), size_(size), pixels_(size.pixels() * 4) {
    render::checkImageSize(size);
    if (!folder_.empty()) std::filesystem::create_directories(folder_);
  }

  void write(runtime::App& app, std::int64_t frame) {
    if (folder_.empty()) return;
    app.renderView(view_, size_, pixels_);
    // The picture for people: without the depth that the alpha channel carries.
    std::vector<std::uint8_t> rgb;
    rgb.reserve(size_.pixels() * 3);
    for (std::size_t i = 0; i < pixels_.size(); i += 4) {
      rgb.insert(rgb.end(), {pixels_[i], pixels_[i + 1], pixels_[i + 2]});
    }
    char name[32];
    std::snprintf(name, sizeof(name), "frame%06lld.png", static_cast<long long>(frame));
    render::writePng(folder_ / name, size_, rgb, 3);
  }

 private:
  std::filesystem::path folder_;
  runtime::View view_;
  render::ImageSize size_;
  std::vector<std::uint8_t> pixels_;
};

}  // namespace

int play(const Arguments& arguments) {
  requireWritable(arguments);
  runtime::AppSettings settings;
  settings.game = arguments.game;
  settings.options_json = gameOptions(arguments);
  settings.log_dir = arguments.log_dir;
  settings.time.target_frame_rate = arguments.frame_rate;
  const auto renderer = render::Renderer::create(render::rendererKindFromName(arguments.renderer));
  runtime::App app(settings, renderer);
  const xr::ScriptedDevice player = makePlayer(arguments.script);
  FrameWriter writer(arguments.record, runtime::viewFromName(arguments.view),
                     {arguments.width, arguments.height});

  Summary summary;
  summary.add(app.reset({.seed = arguments.seed}, player.sample(0)));
  writer.write(app, 0);
  const auto frames = static_cast<std::int64_t>(arguments.seconds * arguments.frame_rate);
  for (std::int64_t frame = 1; frame <= frames && !summary.finished(); ++frame) {
    const std::int64_t time_ns = lockstepFrameTimeNs(frame, arguments.frame_rate);
    summary.add(app.step({time_ns, player.sample(time_ns)}));
    writer.write(app, frame);
  }
  summary.print(std::cout, app);
  return kSuccess;
}

}  // namespace sim2vr::program

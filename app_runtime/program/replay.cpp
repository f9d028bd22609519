// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <iostream>
#include <nlohmann/json.hpp>

#include "outputs.hpp"
#include "sim2vr/core/clock.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/core/options.hpp"
#include "sim2vr/games/registry.hpp"
#include "sim2vr/program/program.hpp"
#include "sim2vr/rl/state_log.hpp"
#include "sim2vr/runtime/app.hpp"
#include "sim2vr/runtime/recorder.hpp"
#include "sim2vr/xr/pose_row.hpp"
#include "summary.hpp"

namespace sim2vr::program {
namespace {

/// Logs give times with 7 digits.
constexpr double kRounding_s = 1e-5;

bool gameHasOption(const std::string& name, const std::string& option) {
  Options options;
  games::createGame(name)->configure(options);
  return options.wasRead(option);
}

/// The command line's options, and what the log fixes: the condition.
std::string replayOptions(const Arguments& arguments, const rl::StateLog& log) {
  nlohmann::json options = nlohmann::json::parse(gameOptions(arguments));
  if (!options.contains("condition") && gameHasOption(arguments.game, "condition")) {
    options["condition"] = log.condition;
  }
  return options.dump();
}

/// Frame times of the log's rows, ns. Rows of a steady frame rate lie exactly where lockstep puts
/// frames; of others, the logged time is all there is.
struct FrameTimes {
  std::vector<std::int64_t> times_ns;
  double fixed_step_tolerance_s = 0.0;
};

FrameTimes frameTimes(const rl::StateLog& log, double rate_hz) {
  const int rate = static_cast<int>(rate_hz);
  const auto onGrid = [rate_hz, rate](const rl::StateLog::Row& row) {
    const double n = std::round(row.time_s * rate);
    // 7 digits are 4e-6 s at the end of a minute.
    return rate == rate_hz && std::abs(row.time_s - n / rate) <= kRounding_s;
  };
  FrameTimes frames;
  const bool steady = std::all_of(log.rows.begin(), log.rows.end(), onGrid);
  for (const rl::StateLog::Row& row : log.rows) {
    frames.times_ns.push_back(steady ? lockstepFrameTimeNs(std::llround(row.time_s * rate), rate)
                                     : std::llround(row.time_s * 1e9));
  }
  if (!steady) frames.fixed_step_tolerance_s = kRounding_s;
  return frames;
}

xr::DeviceState devices(const rl::StateLog::Row& row) {
  return xr::devicesFromRows(row.head.data(), row.left_tracked ? row.left.data() : nullptr,
                             row.right.data());
}

}  // namespace

int replay(const Arguments& arguments) {
  if (arguments.state_log.empty()) {
    throw InvalidArgument("-stateLogFilepath", "none", "the states.csv to replay");
  }
  const rl::StateLog log = rl::readStateLog(arguments.state_log);
  if (!arguments.event_log.empty()) {
    logger().info("-eventLogFilepath is not needed: the events follow from seed and poses");
  }
  requireWritable(arguments);
  const FrameTimes frames = frameTimes(log, arguments.playback_rate);
  runtime::AppSettings settings;
  settings.game = arguments.game;
  settings.options_json = replayOptions(arguments, log);
  settings.headset_size = {arguments.width, arguments.height};
  settings.log_dir = arguments.log_dir;
  settings.time.target_frame_rate = static_cast<int>(arguments.playback_rate);
  settings.time.fixed_step_tolerance_s = frames.fixed_step_tolerance_s;
  runtime::App app(settings,
                   render::Renderer::create(render::rendererKindFromName(arguments.renderer)));
  std::unique_ptr<runtime::Recorder> recorder;
  if (const auto recording = recorderSettings(arguments, settings.time.target_frame_rate)) {
    recorder = std::make_unique<runtime::Recorder>(*recording);
  }

  Summary summary;
  for (std::size_t i = 0; i < log.rows.size() && !summary.finished(); ++i) {
    const xr::DeviceState poses = devices(log.rows[i]);
    const runtime::RoundStart start{.seed = log.seed, .time_ns = frames.times_ns[0]};
    summary.add(i == 0 ? app.reset(start, poses) : app.step({frames.times_ns[i], poses}));
    if (recorder != nullptr) recorder->write(app);
  }
  summary.print(std::cout, app);
  return kSuccess;
}

}  // namespace sim2vr::program

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/program/program.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <system_error>

#include "sim2vr/core/clock.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/core/options.hpp"
#include "sim2vr/core/text.hpp"
#include "sim2vr/games/registry.hpp"
#include "sim2vr/render/image_io.hpp"
#include "sim2vr/rl/state_log.hpp"
#include "sim2vr/runtime/app.hpp"
#include "sim2vr/runtime/recorder.hpp"
#include "sim2vr/server/server.hpp"
#include "sim2vr/xr/pose_row.hpp"
#include "sim2vr/xr/scripted_device.hpp"

namespace sim2vr::program {
namespace {

void requireWritable(const std::string& argument, const std::filesystem::path& folder) {
  if (folder.empty()) return;
  std::error_code problem;
  std::filesystem::create_directories(folder, problem);
  if (!problem && ::access(folder.c_str(), W_OK | X_OK) != 0) {
    problem = std::error_code(errno, std::generic_category());
  }
  if (!problem) return;
  throw InvalidArgument(argument, "'" + folder.string() + "' (" + problem.message() + ")",
                        "a folder that can be written");
}

class Summary {
 public:
  /// The result of the reset, then of every step.
  void add(const runtime::StepResult& result);
  bool finished() const { return latest_.finished; }
  void print(std::ostream& out, runtime::App& app) const;

 private:
  std::int64_t frames_ = -1;
  double reward_ = 0.0;
  runtime::StepResult latest_;
};

std::optional<runtime::RecorderSettings> recorderSettings(const Arguments& arguments,
                                                          int frame_rate) {
  if (arguments.record.empty()) return std::nullopt;
  return runtime::RecorderSettings{.folder = arguments.record,
                                   .size = arguments.resolution,
                                   .mp4 = arguments.record_mp4,
                                   .frame_rate = frame_rate};
}

void requireWritable(const Arguments& arguments) {
  requireWritable("log folder", arguments.log_dir);
  requireWritable("recording folder", arguments.record);
  if (!arguments.record.empty()) recorderSettings(arguments, 1)->validate();
}

void Summary::add(const runtime::StepResult& result) {
  ++frames_;
  // The reset's reward belongs to no step.
  if (frames_ > 0) reward_ += static_cast<double>(result.reward);
  latest_ = result;
}

void Summary::print(std::ostream& out, runtime::App& app) const {
  out << "frames " << frames_ << ", reward " << reward_ << ", "
      << (latest_.finished ? "round over" : "round not over") << ", state hash " << std::hex
      << app.stateHash() << std::dec << "\n";
  for (const auto& [name, value] : latest_.log) {
    // NaN: there is no such number in this round.
    if (!std::isnan(value)) out << "  " << name << " " << value << "\n";
  }
}

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

constexpr int kReferencePort = 5555;
constexpr double kTimeout_s = 60.0;
/// On the reference's default port a developer may be debugging.
constexpr double kDebugTimeout_s = 600.0;

/// For the signal handler, which can have no other context.
server::StopRequest* signalled = nullptr;

/// SIGINT and SIGTERM ask the server to end; a second one ends the process.
class Signals {
 public:
  explicit Signals(server::StopRequest& stop) {
    signalled = &stop;
    struct sigaction action{};
    action.sa_handler = [](int) { signalled->raise(); };
    action.sa_flags = static_cast<int>(SA_RESETHAND);
    ::sigaction(SIGINT, &action, nullptr);
    ::sigaction(SIGTERM, &action, nullptr);
    ::signal(SIGPIPE, SIG_IGN);
  }
  ~Signals() {
    ::signal(SIGINT, SIG_DFL);
    ::signal(SIGTERM, SIG_DFL);
  }
};

/// Takes the descriptors that the hard limit allows, up to a number that is enough: where none is
/// left for a connection, new ones must be closed, and over a Unix socket ZeroMQ 4.3.4 ends the
/// process (ipc_listener.cpp does not expect EMFILE).
void raiseDescriptorLimit() {
  constexpr rlim_t kEnough = 65536;
  struct rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = std::max(limit.rlim_cur, std::min(limit.rlim_max, kEnough));
  ::setrlimit(RLIMIT_NOFILE, &limit);
}

void requireCondition(const Arguments& arguments, const std::string& options) {
  if (!arguments.simulated) return;
  Options given = Options::fromJson(options);
  const auto game = games::createGame(arguments.game);
  game->configure(given);
  if (!given.wasRead("condition") || given.has("condition")) return;
  throw InvalidArgument("-condition", "none next to -simulated",
                        "the condition to play, such as -condition medium");
}

server::ServerSettings serverSettings(const Arguments& arguments) {
  server::ServerSettings settings;
  settings.address = arguments.bind;
  settings.port = arguments.port;
  const double usual_s = arguments.port == kReferencePort ? kDebugTimeout_s : kTimeout_s;
  settings.timeout = std::chrono::milliseconds(
      static_cast<std::int64_t>(std::ceil(1000.0 * arguments.timeout_s.value_or(usual_s))));
  settings.keep = arguments.keep;
  server::HostSettings& host = settings.host;
  host.app.game = arguments.game;
  host.app.options_json = gameOptions(arguments);
  host.app.headset_size = {arguments.width, arguments.height};
  host.app.log_dir = arguments.log_dir;
  host.renderer = arguments.renderer;
  host.recorder = recorderSettings(arguments, 20);
  host.fixed_seed = arguments.fixed_seed;
  host.frame_time = server::protocol1::frameTimeFromName("--frame-time", arguments.frame_time);
  host.clock = server::protocol1::clockOriginFromName("--clock", arguments.clock);
  host.realtime = arguments.realtime;
  host.time_scale = arguments.time_scale;
  host.threads = arguments.threads;
  return settings;
}

/// What a client would be refused for is said before it comes.
void validate(const Arguments& arguments, const server::ServerSettings& settings) {
  requireCondition(arguments, settings.host.app.options_json);
  settings.host.make_app(settings.host.app, render::Renderer::create(render::RendererKind::null),
                         {});
  requireWritable(arguments);
}

int exitCode(server::Ending ending) {
  const bool abandoned =
      ending == server::Ending::timed_out || ending == server::Ending::client_vanished;
  return abandoned ? kAbandoned : kSuccess;
}

int listGames() {
  for (const auto& entry : games::registry()) {
    std::cout << entry.name << "\t" << entry.description << "\n";
  }
  return kSuccess;
}

int runMode(const Arguments& arguments) {
  switch (arguments.mode) {
    case Mode::list_games:
      return listGames();
    case Mode::play:
      return play(arguments);
    case Mode::replay:
      return replay(arguments);
    case Mode::serve:
      break;
  }
  return serve(arguments);
}

int runArguments(const std::vector<std::string>& words) {
  const Arguments arguments = parseArguments(words);
  setLogLevel(arguments.log_level);
  // "-" is Unity's word for the standard output; ours is for the launcher's line.
  if (!arguments.log_file.empty() && arguments.log_file != "-") setLogFile(arguments.log_file);
  for (const std::string& warning : arguments.warnings) logger().warn("{}", warning);
  for (const auto& library : arguments.game_libraries) games::loadGameLibrary(library);
  const int code = runMode(arguments);
  // A launcher need not listen to a server any more; of the others the output is what they are for.
  if (arguments.mode != Mode::serve && !std::cout.flush()) {
    throw EngineError("the standard output cannot be written");
  }
  return code;
}

/// Without this the first socket of a program that was started with its standard output closed
/// would be taken for the output.
void openStandardStreams() {
  for (int stream = 0; stream <= 2; ++stream) {
    if (::fcntl(stream, F_GETFD) == -1) ::open("/dev/null", O_RDWR);
  }
}

int fail(const std::exception& error, int code) {
  std::cerr << "sim2vr-app: " << validUtf8(error.what()) << "\n";
  return code;
}

// The options that the game's condition of that name stands for.
nlohmann::json conditionOptions(const Arguments& arguments) {
  const nlohmann::json facts = nlohmann::json::parse(games::gameFactsJson(arguments.game));
  std::vector<std::string> known;
  for (const nlohmann::json& condition : facts["conditions"]) {
    if (condition["name"] == arguments.condition) return condition["options"];
    known.push_back(condition["name"]);
  }
  throw InvalidArgument("--condition", "'" + arguments.condition + "'",
                        oneOf(known, arguments.condition));
}

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

int serve(const Arguments& arguments) {
  const server::ServerSettings settings = serverSettings(arguments);
  validate(arguments, settings);
  raiseDescriptorLimit();
  server::StopRequest stop;
  const Signals signals(stop);
  server::Server server(settings);
  if (!settings.isLocal()) {
    logger().warn("listening on {}: every client that reaches it can use the app",
                  server.endpoint());
  }
  // Launchers wait for this line.
  std::cout << "sim2vr-app: listening on " << server.endpoint() << std::endl;
  return exitCode(server.run(stop));
}

std::string gameOptions(const Arguments& arguments) {
  nlohmann::json options = jsonObject("options", arguments.options);
  const auto set = [&options](const std::string& argument, const std::string& name,
                              const nlohmann::json& value) {
    const auto found = options.find(name);
    if (found != options.end() && *found != value) {
      throw InvalidArgument(argument,
                            name + " " + value.dump() + " next to --options with " + found->dump(),
                            "one of the two");
    }
    options[name] = value;
  };
  if (!arguments.condition.empty()) {
    const nlohmann::json stands_for = conditionOptions(arguments);
    for (const auto& [name, value] : stands_for.items()) {
      set("--condition", name, value);
    }
  }
  if (arguments.adaptive) set("--adaptive", "adaptive", true);
  if (arguments.sparse) set("--sparse", "sparse", true);
  return options.dump();
}

int run(int argc, const char* const* argv) {
  openStandardStreams();
  try {
    return runArguments(std::vector<std::string>(argv + (argc > 0 ? 1 : 0), argv + argc));
  } catch (const Finished& finished) {
    (finished.exitCode() == kSuccess ? std::cout : std::cerr) << validUtf8(finished.what());
    return finished.exitCode();
  } catch (const std::invalid_argument& error) {
    return fail(error, kBadUsage);
  } catch (const std::exception& error) {
    return fail(error, kFailure);
  }
}

}  // namespace sim2vr::program

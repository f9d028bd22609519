// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/program/arguments.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <limits>
#include <memory>
#include <sstream>
#include <type_traits>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/version.hpp"

namespace sim2vr::program {
namespace {

/// Help text in 80 columns; CLI11 of Debian's version does not wrap.
class OptionHelp : public CLI::Formatter {
 public:
  std::string make_option(const CLI::Option* option, bool is_positional) const override {
    const std::string name =
        "  " + make_option_name(option, is_positional) + make_option_opts(option);
    std::ostringstream out;
    out << name;
    std::size_t column = name.size();
    if (column + 1 > kHelpColumn) {
      out << '\n';
      column = 0;
    }
    std::istringstream words(make_option_desc(option));
    std::string word;
    bool is_first = true;
    while (words >> word) {
      if (!is_first && column + 1 + word.size() > kColumns) {
        out << '\n';
        column = 0;
        is_first = true;
      }
      if (is_first) {
        out << std::string(kHelpColumn - column, ' ');
        column = kHelpColumn;
      } else {
        out << ' ';
        ++column;
      }
      out << word;
      column += word.size();
      is_first = false;
    }
    out << '\n';
    return out.str();
  }

 private:
  static constexpr std::size_t kColumns = 80;
  static constexpr std::size_t kHelpColumn = 28;
};

/// Longest time that is taken, s: 30 years.
constexpr double kLongest_s = 1e9;

/// Options that CLI11 reads into something else than Arguments.
struct Raw {
  std::string record;
  std::string resolution;
  double timeout_s = 0.0;
  bool list_games = false;
  bool play = false;
  bool replay = false;
  bool logging = false;
};

/// The numbers from `low` to `high` (of double, those above 0 where `low` is 0), in words.
template <class T>
std::string rangeWords(T low, T high) {
  std::ostringstream words;
  if (std::is_floating_point_v<T> && low == T{}) {
    words << "a number above 0, at most " << high;
  } else {
    words << (std::is_integral_v<T> ? "a whole number from " : "a number from ") << low << " to "
          << high;
  }
  return words.str();
}

/// An option whose value is a number from `low` to `high`; doubles also exclude 0. CLI11's own
/// checks let NaN pass and print all digits of the largest double.
template <class T>
CLI::Option* addNumber(CLI::App& cli, const std::string& name, T& value, T low, T high,
                       const std::string& help) {
  std::ostringstream usual;
  usual << value;
  const auto read = [name, &value, low, high](const std::string& text) {
    T number{};
    const char* end = text.data() + text.size();
    const auto [stop, problem] = std::from_chars(text.data(), end, number);
    bool fits = problem == std::errc() && stop == end && number >= low && number <= high;
    if constexpr (std::is_floating_point_v<T>) fits = fits && number > 0.0;
    if (!fits) throw InvalidArgument(name, "'" + text + "'", rangeWords(low, high));
    value = number;
  };
  return cli.add_option_function<std::string>(name, read, help)
      ->type_name("N")
      ->default_str(value == T{} && std::is_floating_point_v<T> ? "" : usual.str());
}

constexpr std::uint32_t kLastSeed = std::numeric_limits<std::uint32_t>::max();

void addGameOptions(CLI::App& cli, Arguments& arguments, Raw& raw) {
  cli.add_flag("--list-games", raw.list_games, "List the games and exit")->group("Game");
  cli.add_option("--game-library", arguments.game_libraries,
                 "A shared library of games, whose code is run; may be repeated")
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->expected(1)
      ->group("Game");
  cli.add_option("--game", arguments.game, "Which game to run")->group("Game");
  cli.add_option("--condition", arguments.condition, "The game's condition")->group("Game");
  cli.add_option("--options", arguments.options, "The game's options as a JSON object")
      ->group("Game");
  cli.add_flag("--adaptive", arguments.adaptive, "The game's option adaptive")->group("Game");
  cli.add_flag("--sparse", arguments.sparse, "The game's option sparse")->group("Game");
  cli.add_option("--renderer", arguments.renderer, "automatic, egl, osmesa or null")->group("Game");
  addNumber(cli, "--width", arguments.width, 1, render::kMaxImageEdge,
            "Width of the headset image (--play: of the recorded pictures), pixels")
      ->group("Game");
  addNumber(cli, "--height", arguments.height, 1, render::kMaxImageEdge, "Height of it, pixels")
      ->group("Game");
}

void addServerOptions(CLI::App& cli, Arguments& arguments, Raw& raw) {
  const std::string group = "Serving (the default)";
  addNumber(cli, "--port", arguments.port, 0, 65535, "TCP port; 0 picks a free one")->group(group);
  cli.add_option("--bind", arguments.bind,
                 "Address to listen on, or an endpoint such as ipc:///tmp/app; who reaches it "
                 "can use the app")
      ->group(group);
  addNumber(cli, "--timeout", raw.timeout_s, 0.0, kLongest_s,
            "Longest wait for a message, s (60; 600 on port 5555)")
      ->group(group);
  cli.add_flag("--keep", arguments.keep, "After a client wait for the next one")->group(group);
  addNumber(cli, "--fixed-seed", arguments.fixed_seed, 0U, kLastSeed,
            "Seed of every round of protocol 1; 0 draws seeds")
      ->group(group);
  cli.add_option("--frame-time", arguments.frame_time,
                 "Protocol 1: frames lie at the 'next' or the 'current' timestep")
      ->group(group);
  cli.add_option("--clock", arguments.clock,
                 "Protocol 1: the game clock is 'absolute' or starts with each 'round'")
      ->group(group);
  cli.add_flag("--realtime", arguments.realtime, "Pace frames against the wall clock")
      ->group(group);
  addNumber(cli, "--time-scale", arguments.time_scale, 0.0, 1e6,
            "Game seconds per second then; default: the client's timeScale")
      ->group(group);
  addNumber(cli, "--threads", arguments.threads, 1, 256, "Threads for several apps of one client")
      ->group(group);
  cli.add_flag("--simulated", arguments.simulated,
               "As the reference is started: --condition is required")
      ->group(group);
}

void addOutputOptions(CLI::App& cli, Arguments& arguments, Raw& raw) {
  const std::string group = "Output";
  cli.add_option("--output-folder", arguments.output_folder,
                 "Root of the folders logging and recording")
      ->group(group);
  cli.add_flag("--logging", raw.logging, "Episode logs in the folder logging")->group(group);
  cli.add_option("--log-dir", arguments.log_dir, "Episode logs in this folder")->group(group);
  cli.add_option("--record", raw.record,
                 "Pictures of every frame, third person and headset, in this folder (default: "
                 "recording in the output folder)")
      ->expected(0, 1)
      ->group(group);
  cli.add_flag("--record-mp4", arguments.record_mp4,
               "Videos instead of pictures; needs the program ffmpeg")
      ->group(group);
  cli.add_option("--resolution", raw.resolution,
                 "Size of recorded pictures, WIDTHxHEIGHT (1280x960)")
      ->group(group);
  cli.add_option("--log-file", arguments.log_file, "The program's own log; default: stderr")
      ->group(group);
  cli.add_option("--log-level", arguments.log_level, "trace, debug, info, warning, error or off")
      ->group(group);
}

void addPlayerOptions(CLI::App& cli, Arguments& arguments, Raw& raw) {
  const std::string play = "Playing a round (--play, --script or --seconds)";
  cli.add_flag("--play", raw.play, "Play one round without a client and exit")->group(play);
  cli.add_option("--script", arguments.script,
                 "Timeline of device poses as JSON; a resting player without it")
      ->group(play);
  addNumber(cli, "--seed", arguments.seed, 0U, kLastSeed, "Seed of the round")->group(play);
  addNumber(cli, "--seconds", arguments.seconds, 0.0, kLongest_s, "Game time to play at most, s")
      ->group(play);
  addNumber(cli, "--frame-rate", arguments.frame_rate, 1, 1000, "Frames per second of game time")
      ->group(play);
  cli.add_option("--view", arguments.view, "What is recorded: headset, recorder or spectator")
      ->group(play);
  const std::string replay = "Replaying a recorded round (--replay)";
  cli.add_flag("--replay", raw.replay, "Play a recorded round again from its seed and poses")
      ->group(replay);
  cli.add_option("--state-log", arguments.state_log, "Its states.csv")->group(replay);
  cli.add_option("--event-log", arguments.event_log, "Its events.csv, which is not needed")
      ->group(replay);
  addNumber(cli, "--playback-rate", arguments.playback_rate, 1.0, 1000.0,
            "Frames per second of the recording")
      ->group(replay);
}

render::ImageSize parseResolution(const std::string& text) {
  render::ImageSize size;
  const char* end = text.data() + text.size();
  const auto width = std::from_chars(text.data(), end, size.width);
  if (width.ec == std::errc() && width.ptr != end && *width.ptr == 'x') {
    const auto height = std::from_chars(width.ptr + 1, end, size.height);
    if (height.ec == std::errc() && height.ptr == end) {
      render::checkImageSize(size);
      return size;
    }
  }
  throw InvalidArgument("--resolution", "'" + text + "'", "WIDTHxHEIGHT, such as 1280x960");
}

/// What is wrong with the command line: field, got, expected.
std::string mistake(const CLI::App& cli, const CLI::ParseError& error) {
  if (dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr && !cli.remaining().empty()) {
    std::vector<std::string> names;
    for (const CLI::Option* option : cli.get_options()) {
      for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    }
    const std::string given = cli.remaining().front();
    return given + ": got an unknown argument, expected an option" + didYouMean(given, names);
  }
  if (dynamic_cast<const CLI::ArgumentMismatch*>(&error) != nullptr) {
    const std::string text = error.what();
    return text.substr(0, text.find(':')) + ": got no value, expected one";
  }
  return error.what();
}

Mode chosenMode(const CLI::App& cli, const Raw& raw) {
  if (raw.list_games) return Mode::list_games;
  if (raw.replay) return Mode::replay;
  const bool plays = raw.play || cli.count("--script") > 0 || cli.count("--seconds") > 0;
  if (!plays) return Mode::serve;
  if (cli.count("--port") == 0) return Mode::play;
  throw InvalidArgument("--port", "one next to --play, --script or --seconds",
                        "a round played here or clients served, not both");
}

}  // namespace

Arguments parseArguments(const std::vector<std::string>& words) {
  Arguments arguments;
  Raw raw;
  CLI::App cli("A VR game of the sim2vr runtime, in lockstep and without a display.", "sim2vr-app");
  cli.formatter(std::make_shared<OptionHelp>());
  cli.option_defaults()->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
  cli.option_defaults()->always_capture_default();
  cli.set_version_flag("--version", "sim2vr-app " + std::string(version()));
  cli.footer(
      "The reference's arguments (-simulated -port N -condition C -adaptive -sparse\n"
      "-fixedSeed N -logging -record -resolution WxH -outputFolder DIR -logFile F\n"
      "-replay -stateLogFilepath F -eventLogFilepath F -playbackRate N) mean the same.\n"
      "Exit codes: 0 done, 1 failed, 2 wrong arguments, 3 the client vanished or timed\n"
      "out.");
  addGameOptions(cli, arguments, raw);
  addServerOptions(cli, arguments, raw);
  addOutputOptions(cli, arguments, raw);
  addPlayerOptions(cli, arguments, raw);
  std::vector<std::string> reversed = translateReferenceArguments(words, arguments.warnings);
  std::reverse(reversed.begin(), reversed.end());
  try {
    cli.parse(reversed);
  } catch (const CLI::ParseError& error) {
    std::ostringstream out;
    std::ostringstream err;
    const int code = cli.exit(error, out, err);
    if (code == 0) throw Finished(out.str(), 0);
    throw Finished("sim2vr-app: " + mistake(cli, error) + " (see sim2vr-app --help)\n", kBadUsage);
  }
  arguments.mode = chosenMode(cli, raw);
  if (cli.count("--timeout") > 0) arguments.timeout_s = raw.timeout_s;
  if (!raw.resolution.empty()) arguments.resolution = parseResolution(raw.resolution);
  if (raw.logging && arguments.log_dir.empty()) {
    arguments.log_dir = arguments.output_folder / "logging";
  }
  arguments.record = raw.record;
  if ((cli.count("--record") > 0 || arguments.record_mp4) && raw.record.empty()) {
    arguments.record = arguments.output_folder / "recording";
  }
  return arguments;
}

}  // namespace sim2vr::program

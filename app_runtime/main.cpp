// sim2vr-app: a VR game of the runtime as a program of its own. It plays a round with a scripted or
// a resting player, in lockstep and without a display, and writes the pictures and logs of it.
#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "sim2vr/core/clock.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/core/version.hpp"
#include "sim2vr/games/registry.hpp"
#include "sim2vr/render/image_io.hpp"
#include "sim2vr/runtime/app.hpp"
#include "sim2vr/xr/frames.hpp"
#include "sim2vr/xr/scripted_device.hpp"

namespace {

using namespace sim2vr;

constexpr int kBadUsage = 2;

struct Arguments {
  std::string game = "whacamole";
  std::string condition;
  std::string options = "{}";
  std::string script;
  std::string renderer = "automatic";
  std::string log_level = "info";
  std::string view = "headset";
  std::filesystem::path record;
  std::filesystem::path log_dir;
  int width = 120;
  int height = 80;
  std::uint32_t seed = 0;
  double seconds = 5.0;
  int frame_rate = 20;
  bool list_games = false;
};

/// A player who stands still: head at 1.17 m, right hand in front of the chest.
xr::DeviceState restingPlayer() {
  xr::DeviceState state;
  state.head = xr::toXr(Pose{Vec3(0.0, 1.17, 0.0), Quat::Identity()});
  xr::ControllerState& right = state.hand(xr::Hand::right);
  right.active = true;
  right.grip = xr::toXr(Pose{Vec3(0.18, 0.9, 0.25), Quat::Identity()});
  right.aim = xr::compose(right.grip, xr::kGripToAim);
  return state;
}

std::string readFile(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw InvalidArgument("--script", "'" + path + "'", "a readable JSON file");
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

std::unique_ptr<xr::Device> makePlayer(const std::string& script) {
  if (!script.empty()) {
    return std::make_unique<xr::ScriptedDevice>(xr::ScriptedDevice::fromJson(readFile(script)));
  }
  return std::make_unique<xr::ScriptedDevice>(
      std::vector<xr::Keyframe>{{.time = 0, .state = restingPlayer()}});
}

void listGames() {
  for (const auto& entry : games::registry()) {
    std::cout << entry.name << "\t" << entry.description << "\n";
  }
}

std::string gameOptions(const Arguments& arguments) {
  if (arguments.condition.empty()) return arguments.options;
  if (arguments.options != "{}") {
    throw InvalidArgument("--condition", "'" + arguments.condition + "' next to --options",
                          "one of the two; --options can hold the condition");
  }
  return nlohmann::json{{"condition", arguments.condition}}.dump();
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

void play(const Arguments& arguments) {
  runtime::AppSettings settings;
  settings.game = arguments.game;
  settings.options_json = gameOptions(arguments);
  settings.log_dir = arguments.log_dir;
  settings.time.target_frame_rate = arguments.frame_rate;
  const auto renderer = render::Renderer::create(render::rendererKindFromName(arguments.renderer));
  runtime::App app(settings, renderer);
  const std::unique_ptr<xr::Device> player = makePlayer(arguments.script);
  FrameWriter writer(arguments.record, runtime::viewFromName(arguments.view),
                     {arguments.width, arguments.height});

  double total_reward = 0.0;
  runtime::StepResult result = app.reset({.seed = arguments.seed}, player->sample(0));
  writer.write(app, 0);
  const auto frames = static_cast<std::int64_t>(arguments.seconds * arguments.frame_rate);
  std::int64_t frame = 0;
  while (frame < frames && !result.finished) {
    ++frame;
    const std::int64_t time_ns = lockstepFrameTimeNs(frame, arguments.frame_rate);
    result = app.step({time_ns, player->sample(time_ns)});
    total_reward += static_cast<double>(result.reward);
    writer.write(app, frame);
  }
  std::cout << "frames " << frame << ", reward " << total_reward << ", "
            << (result.finished ? "round over" : "round not over") << ", state hash " << std::hex
            << app.stateHash() << std::dec << "\n";
  for (const auto& [name, value] : result.log) std::cout << "  " << name << " " << value << "\n";
}

void addOptions(CLI::App& cli, Arguments& arguments) {
  cli.set_version_flag("--version", "sim2vr-app " + std::string(version()));
  cli.add_flag("--list-games", arguments.list_games, "List the games and exit");
  cli.add_option("--game", arguments.game, "Which game to run")->capture_default_str();
  cli.add_option("--condition", arguments.condition, "The game's condition");
  cli.add_option("--options", arguments.options, "The game's options as a JSON object");
  cli.add_option("--script", arguments.script,
                 "Timeline of device poses as JSON; a resting player without it");
  cli.add_option("--seed", arguments.seed, "Seed of the round")->capture_default_str();
  cli.add_option("--seconds", arguments.seconds, "Game time to play at most, s")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  cli.add_option("--frame-rate", arguments.frame_rate, "Frames per second of game time")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  cli.add_option("--record", arguments.record, "Folder for a PNG per frame");
  cli.add_option("--view", arguments.view, "What is recorded: headset, recorder or spectator")
      ->capture_default_str();
  cli.add_option("--width", arguments.width, "Width of the recorded pictures, pixels")
      ->capture_default_str();
  cli.add_option("--height", arguments.height, "Height of the recorded pictures, pixels")
      ->capture_default_str();
  cli.add_option("--log-dir", arguments.log_dir, "Folder for states.csv and events.csv");
  cli.add_option("--renderer", arguments.renderer, "automatic, egl, osmesa or null")
      ->capture_default_str();
  cli.add_option("--log-level", arguments.log_level, "trace, debug, info, warning, error or off")
      ->capture_default_str();
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  CLI::App cli("Runs a VR game of the sim2vr runtime in lockstep, without a display.");
  addOptions(cli, arguments);
  try {
    cli.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    const int code = cli.exit(error);
    return code == 0 ? 0 : kBadUsage;
  }
  try {
    setLogLevel(arguments.log_level);
    if (arguments.list_games) {
      listGames();
    } else {
      play(arguments);
    }
  } catch (const std::invalid_argument& error) {
    std::cerr << "sim2vr-app: " << error.what() << "\n";
    return kBadUsage;
  } catch (const std::exception& error) {
    std::cerr << "sim2vr-app: " << error.what() << "\n";
    return 1;
  }
  return 0;
}

// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/program/program.hpp"

#include <fcntl.h>

#include <iostream>
#include <nlohmann/json.hpp>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/core/options.hpp"
#include "sim2vr/core/text.hpp"
#include "sim2vr/games/registry.hpp"

namespace sim2vr::program {
namespace {

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

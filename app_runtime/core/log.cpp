// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/log.hpp"

#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>

#include <array>
#include <memory>
#include <string>
#include <system_error>
#include <utility>

#include "sim2vr/core/errors.hpp"

namespace sim2vr {

spdlog::logger& logger() {
  static const std::shared_ptr<spdlog::logger> instance = [] {
    auto created = std::make_shared<spdlog::logger>(
        "sim2vr", std::make_shared<spdlog::sinks::stderr_color_sink_mt>());
    created->set_level(spdlog::level::warn);
    created->set_pattern("%n: %^%l%$: %v");
    return created;
  }();
  return *instance;
}

void setLogLevel(std::string_view level) {
  static const std::array<std::pair<std::string_view, spdlog::level::level_enum>, 6> kLevels{{
      {"trace", spdlog::level::trace},
      {"debug", spdlog::level::debug},
      {"info", spdlog::level::info},
      {"warning", spdlog::level::warn},
      {"error", spdlog::level::err},
      {"off", spdlog::level::off},
  }};
  for (const auto& [name, value] : kLevels) {
    if (name == level) {
      logger().set_level(value);
      return;
    }
  }
  throw InvalidArgument("log level", "'" + std::string(level) + "'",
                        "'trace', 'debug', 'info', 'warning', 'error' or 'off'");
}

void setLogFile(const std::filesystem::path& path) {
  std::error_code problem;
  // Opening a pipe waits for its reader.
  if (std::filesystem::is_fifo(path, problem)) {
    throw InvalidArgument("log file", "'" + path.string() + "' (a pipe)", "a file");
  }
  if (path.has_parent_path()) std::filesystem::create_directories(path.parent_path(), problem);
  try {
    const auto sink =
        std::make_shared<spdlog::sinks::basic_file_sink_mt>(path.string(), /*truncate=*/true);
    logger().sinks() = {sink};
  } catch (const spdlog::spdlog_ex& error) {
    throw InvalidArgument("log file", "'" + path.string() + "' (" + error.what() + ")",
                          "a file that can be written");
  }
  logger().set_pattern("%Y-%m-%d %H:%M:%S.%e %n: %l: %v");
  logger().flush_on(spdlog::level::info);
}

}  // namespace sim2vr

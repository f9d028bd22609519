#include "sim2vr/core/log.hpp"

#include <spdlog/sinks/stdout_color_sinks.h>

#include <array>
#include <memory>
#include <string>
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

}  // namespace sim2vr

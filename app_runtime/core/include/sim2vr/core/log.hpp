// The runtime's log: spdlog to standard error. Silent below "warning" unless asked, so that the
// extension module does not write into a Python program's output.
#pragma once

#include <spdlog/spdlog.h>

#include <string_view>

namespace sim2vr {

/// The runtime's own logger ("sim2vr"), created on first use. Thread-safe.
spdlog::logger& logger();

/// Sets the level: "trace", "debug", "info", "warning", "error" or "off".
/// Throws InvalidArgument for another word.
void setLogLevel(std::string_view level);

}  // namespace sim2vr

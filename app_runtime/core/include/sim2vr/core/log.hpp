// SPDX-License-Identifier: Apache-2.0
// The runtime's log: spdlog to standard error. Silent below "warning" unless asked, so that the
// extension module does not write into a Python program's output.
#pragma once

#include <spdlog/spdlog.h>

#include <filesystem>
#include <string_view>

namespace sim2vr {

/// The runtime's own logger ("sim2vr"), created on first use. Thread-safe.
spdlog::logger& logger();

/// Sets the level: "trace", "debug", "info", "warning", "error" or "off".
/// Throws InvalidArgument for another word.
void setLogLevel(std::string_view level);

/// Writes to this file, emptied first, instead of to standard error; makes its folder. Throws
/// InvalidArgument when that is not possible. Call it before other threads log.
void setLogFile(const std::filesystem::path& path);

}  // namespace sim2vr

// SPDX-License-Identifier: Apache-2.0
#include "outputs.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>

#include "sim2vr/core/errors.hpp"

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

}  // namespace

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

}  // namespace sim2vr::program

// SPDX-License-Identifier: Apache-2.0
// Where logs and pictures go.
#pragma once

#include <optional>

#include "sim2vr/program/arguments.hpp"
#include "sim2vr/runtime/recorder.hpp"

namespace sim2vr::program {

/// None when nothing is recorded.
std::optional<runtime::RecorderSettings> recorderSettings(const Arguments& arguments,
                                                          int frame_rate);

/// Makes the folders for logs and pictures. Throws InvalidArgument naming the argument when that is
/// not possible or ffmpeg is missing.
void requireWritable(const Arguments& arguments);

}  // namespace sim2vr::program

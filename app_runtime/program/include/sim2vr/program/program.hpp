// SPDX-License-Identifier: Apache-2.0
// What sim2vr-app does.
#pragma once

#include "sim2vr/program/arguments.hpp"

namespace sim2vr::program {

inline constexpr int kSuccess = 0;
inline constexpr int kFailure = 1;
/// The client vanished or nothing came before the time-out.
inline constexpr int kAbandoned = 3;

/// Serves clients until the session is over.
int serve(const Arguments& arguments);
/// Plays a round with a scripted or a resting player.
int play(const Arguments& arguments);
/// Plays a recorded round again from its seed and poses.
int replay(const Arguments& arguments);

/// The whole program; its exit code. What goes wrong is one line on stderr.
int run(int argc, const char* const* argv);

/// The game's options from all arguments that concern it. Throws InvalidArgument when two of them
/// contradict each other.
std::string gameOptions(const Arguments& arguments);

}  // namespace sim2vr::program

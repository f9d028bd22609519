// SPDX-License-Identifier: Apache-2.0
// The command line of sim2vr-app: our own options and the reference's single-dash arguments.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "sim2vr/render/image_size.hpp"

namespace sim2vr::program {

inline constexpr int kBadUsage = 2;  ///< Exit status.

enum class Mode : std::uint8_t { serve, play, replay, list_games };

struct Arguments {
  Mode mode = Mode::serve;

  /// Shared libraries with games of their own.
  std::vector<std::filesystem::path> game_libraries;
  std::string game = "whacamole";
  std::string condition;
  std::string options = "{}";
  bool adaptive = false;
  bool sparse = false;
  /// Started as the reference starts its app: the condition must be named.
  bool simulated = false;

  int port = 5555;
  std::string bind = "127.0.0.1";
  std::optional<double> timeout_s;
  bool keep = false;
  std::uint32_t fixed_seed = 0;
  std::string frame_time = "next";
  std::string clock = "absolute";
  bool realtime = false;
  double time_scale = 0.0;
  int threads = 1;

  std::string renderer = "automatic";
  int width = 120;
  int height = 80;

  std::filesystem::path output_folder = ".";
  /// Root of the episode logs; empty: none.
  std::filesystem::path log_dir;
  /// Folder of the recording; empty: none.
  std::filesystem::path record;
  bool record_mp4 = false;
  render::ImageSize resolution{1280, 960};
  std::filesystem::path log_file;
  std::string log_level = "info";

  // Of play.
  std::string script;
  std::uint32_t seed = 0;
  double seconds = 5.0;
  int frame_rate = 20;
  std::string view = "headset";

  // Of replay.
  std::filesystem::path state_log;
  std::filesystem::path event_log;
  double playback_rate = 20.0;

  /// What was not understood, one line each.
  std::vector<std::string> warnings;
};

/// Help or version text was requested, or the command line cannot be used.
class Finished : public std::runtime_error {
 public:
  Finished(const std::string& text, int code) : std::runtime_error(text), code_(code) {}
  int exitCode() const { return code_; }

 private:
  int code_;
};

/// From main's arguments without the program's name. Throws Finished, and InvalidArgument for
/// values that cannot be used.
Arguments parseArguments(const std::vector<std::string>& words);

/// Rewrites the reference's single-dash arguments, in any order and as "-port 5555", "-port=5555"
/// or
/// "-port 5555" in one word, as our own options. Unknown ones are left out with a warning, and
/// their values too. Throws InvalidArgument for a missing value.
std::vector<std::string> translateReferenceArguments(const std::vector<std::string>& words,
                                                     std::vector<std::string>& warnings);

}  // namespace sim2vr::program

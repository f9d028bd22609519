// SPDX-License-Identifier: Apache-2.0
// Episode logs in the reference's text format (docs/reference/games/whacamole.md, "Logs"): one
// folder per round with states.csv (tracked poses, one row per frame) and events.csv (what
// happened, when).
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/core/math.hpp"

namespace sim2vr::rl {

/// A binary32 number with as few digits as give it back when read, exponent as E-05. The reference
/// writes 7 digits, from which a replay cannot get the very same poses and times.
std::string formatFloat(double value);
/// "x y z".
std::string formatVector(const Vec3& vector);
/// Position, then quaternion: "x y z qx qy qz qw".
std::string formatPose(const Pose& pose);

/// Writes <root>/<round index, 4 digits>-<condition>/{states,events}.csv. The index counts the
/// rounds of this logger from 0, so that the same run writes the same paths; files of an earlier
/// run in the same root are overwritten. Not part of saved states: a loaded state goes on in the
/// open files.
class EpisodeLogger {
 public:
  explicit EpisodeLogger(std::filesystem::path root);
  /// Closes an open round; a failure there is logged, not thrown.
  ~EpisodeLogger();
  EpisodeLogger(const EpisodeLogger&) = delete;
  EpisodeLogger& operator=(const EpisodeLogger&) = delete;

  /// Opens the next round's folder, closing the one before. `pose_names` head the columns of
  /// states.csv. Throws EngineError when the files cannot be written.
  void beginRound(std::string_view condition, std::uint32_t seed,
                  std::span<const std::string> pose_names);

  /// A row of states.csv: time, s, and one world pose per name. Ignored outside a round.
  void state(float time_s, std::span<const Pose> poses);
  /// A row of events.csv. Ignored outside a round.
  void event(float time_s, std::string_view text);

  /// Flushes and closes the round's files. Throws EngineError when something could not be written.
  void endRound();

  bool inRound() const { return states_.is_open(); }
  /// Folder of the current or latest round; empty before the first.
  const std::filesystem::path& folder() const { return folder_; }

 private:
  std::filesystem::path root_;
  std::filesystem::path folder_;
  std::ofstream states_;
  std::ofstream events_;
  std::size_t pose_count_ = 0;
  int round_index_ = 0;
};

}  // namespace sim2vr::rl

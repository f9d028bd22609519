// SPDX-License-Identifier: Apache-2.0
// Reads what EpisodeLogger and the reference write to states.csv: the tracked poses of a round.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace sim2vr::rl {

struct StateLog {
  /// Position x y z (m), rotation x y z w, app frame.
  using PoseNumbers = std::array<double, 7>;

  struct Row {
    double time_s = 0.0;
    PoseNumbers head{};
    PoseNumbers left{};
    PoseNumbers right{};
    /// The left controller reads as the origin while it is off.
    bool left_tracked = false;
  };

  std::string condition;
  std::uint32_t seed = 0;
  std::vector<Row> rows;
};

/// Fields are separated by commas, tabs and spaces, so that what a spreadsheet saved is read as
/// well; a last row that was cut off is left out. sessions/state_log.py reads the same.
/// Throws InvalidArgument ("states.csv line N") for another format, times that go backwards and a
/// round without rows.
StateLog parseStateLog(std::string_view text);

/// Throws InvalidArgument when the file cannot be read, too.
StateLog readStateLog(const std::filesystem::path& path);

}  // namespace sim2vr::rl

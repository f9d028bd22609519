// SPDX-License-Identifier: Apache-2.0
// From the files of a map to a level.
#pragma once

#include <string>

#include "beats/level.hpp"
#include "beats/map_files.hpp"

namespace sim2vr::games::beats {

/// Reads one difficulty of a map; its names as in chooseDifficulty (map_info.hpp). Throws
/// InvalidArgument naming file, object and field, or the option.
Level readMapLevel(const MapFiles& files, const std::string& characteristic,
                   const std::string& difficulty);

/// Reads a level from a folder with Info.dat, a zipped one, or a single difficulty (.dat or .json),
/// which takes tempo and speed from the Info.dat beside it that lists it. Without one the tempo is
/// the file's own at beat 0, the speed 10 m/s. Throws as readMapLevel does.
Level loadLevel(const std::string& path, const std::string& characteristic,
                const std::string& difficulty);

}  // namespace sim2vr::games::beats

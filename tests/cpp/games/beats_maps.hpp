// SPDX-License-Identifier: Apache-2.0
// Maps for the tests of Beats' loader.
#pragma once

#include <map>
#include <string>

#include "beats/level_options.hpp"
#include "beats/map_files.hpp"
#include "error_of.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats::testing {

/// An Info.dat with the difficulty Easy in Easy.dat: 60 beats a minute, 10 m/s.
inline std::string easyInfo() {
  return R"({"_version": "2.0.0", "_songName": "test", "_beatsPerMinute": 60,
    "_difficultyBeatmapSets": [{"_beatmapCharacteristicName": "Standard", "_difficultyBeatmaps": [
      {"_difficulty": "Easy", "_beatmapFilename": "Easy.dat", "_noteJumpMovementSpeed": 10}]}]})";
}

inline Level readEasy(const std::string& difficulty) {
  return readMapLevel(MemoryFiles({{"Info.dat", easyInfo()}, {"Easy.dat", difficulty}}, "map"), "",
                      "");
}

/// The same with the objects of version 3 that are given, such as R"("bombNotes": [])", and a box.
inline Level readEasy3(const std::string& objects) {
  return readEasy(R"({"version": "3.3.0", "colorNotes": [{"b": 1}], )" + objects + "}");
}

}  // namespace sim2vr::games::beats::testing

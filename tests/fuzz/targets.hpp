// SPDX-License-Identifier: Apache-2.0
// What is fuzzed: everything that reads bytes from outside. A target takes any input; what it must
// not do is crash, hang, run out of memory, or accept something and then contradict itself.
#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "sim2vr/server/session.hpp"

namespace sim2vr::fuzz {

/// JSON of handshakes and states.
void protocol1(std::string_view input);
/// Messages of protocol 2: frames, each after its length (2 bytes, little-endian).
void protocol2(std::string_view input);
void base64(std::string_view input);
/// states.csv.
void stateLog(std::string_view input);
/// States after a handshake, separated by a zero byte, answered by an app.
void session1(std::string_view input);
/// Messages after a hello, as in protocol2 and separated by a frame of length 0xFFFF, answered by
/// two apps.
void session2(std::string_view input);
/// Saved states of an app.
void savedState(std::string_view input);
/// Of one that plays Beats.
void savedBeats(std::string_view input);

/// A map of Beats: Info.dat, its difficulty and its audio file, separated by zero bytes; they are
/// found under whatever names Info.dat has for them.
void level(std::string_view input);
/// A zipped map.
void levelZip(std::string_view input);

/// A harness's messages to the OpenXR runtime, one after the other.
void openxrMessages(std::string_view input);

/// Ends the program unless `holds`.
void require(bool holds, const char* what);

/// The first message of an input of session2, which is shortened by it.
std::vector<std::string_view> takeFrames(std::string_view& input);
/// Of the apps that are fuzzed.
server::HostSettings hostSettings();
/// Of the app that plays Beats.
runtime::AppSettings beatsSettings();

struct Target {
  std::string_view name;
  void (*run)(std::string_view input);
};

inline constexpr std::array<Target, 11> kTargets{{{"protocol1", &protocol1},
                                                  {"protocol2", &protocol2},
                                                  {"base64", &base64},
                                                  {"state_log", &stateLog},
                                                  {"session1", &session1},
                                                  {"session2", &session2},
                                                  {"saved_state", &savedState},
                                                  {"saved_beats", &savedBeats},
                                                  {"level", &level},
                                                  {"level_zip", &levelZip},
                                                  {"openxr", &openxrMessages}}};

}  // namespace sim2vr::fuzz

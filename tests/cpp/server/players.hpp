// SPDX-License-Identifier: Apache-2.0
// A player, the messages that carry its poses in both protocols, and the same round in process.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "sim2vr/core/clock.hpp"
#include "sim2vr/runtime/app.hpp"
#include "sim2vr/server/message.hpp"
#include "sim2vr/server/protocol2.hpp"

namespace sim2vr::server::testing {

using Json = nlohmann::json;

inline constexpr int kRate_hz = 20;

inline std::int64_t frameNs(std::int64_t frame) { return lockstepFrameTimeNs(frame, kRate_hz); }

/// Poses of frame n of a player who moves head and hammer smoothly and strikes in between. The
/// numbers have all their binary64 digits.
inline TrackedPoses playerPoses(int n) {
  const double t = 0.05 * n;
  const double tilt = 0.1 * std::sin(0.7 * t);
  TrackedPoses poses;
  poses.head = {0.02 * std::sin(t), 1.17, 0.01 * std::cos(2.0 * t), std::sin(tilt), 0.0, 0.0,
                std::cos(tilt)};
  poses.right = {0.15 + 0.1 * std::sin(1.3 * t),
                 1.03 + 0.1 * std::cos(1.7 * t),
                 n % 4 == 3 ? 0.36 : 0.2,
                 0.0,
                 std::sin(tilt),
                 0.0,
                 std::cos(tilt)};
  poses.head_tracked = true;
  poses.right_tracked = true;
  return poses;
}

inline void addPose(Json& message, const std::string& device, const PoseNumbers& pose) {
  message[device + "Position"] = {{"x", pose[0]}, {"y", pose[1]}, {"z", pose[2]}};
  message[device + "Rotation"] = {{"x", pose[3]}, {"y", pose[4]}, {"z", pose[5]}, {"w", pose[6]}};
}

/// The pose fields of protocol 1, as User-in-the-Box sends them.
inline Json posesJson(const TrackedPoses& poses) {
  Json message = Json::object();
  addPose(message, "headset", poses.head);
  addPose(message, "rightController", poses.right);
  addPose(message, "leftController", {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0});
  return message;
}

/// A State at `current_s` on the user's clock.
inline Json stateJson(const TrackedPoses& poses, double current_s, bool reset = false) {
  Json message = posesJson(poses);
  message["currentTimestep"] = current_s;
  message["nextTimestep"] = current_s + 1.0 / kRate_hz;
  message["reset"] = reset;
  message["isFinished"] = false;
  return message;
}

inline Json handshakeJson() {
  return {{"timestep", 0.002}, {"sampleFrequency", kRate_hz}, {"timeScale", 5}};
}

template <class T>
void append(std::string& bytes, T value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof(T));
}

template <class T>
T read(const std::string& bytes, std::size_t offset) {
  T value;
  std::memcpy(&value, bytes.data() + offset, sizeof(T));
  return value;
}

inline std::string poseBlock(const TrackedPoses& poses) {
  std::string bytes;
  append<std::uint32_t>(bytes, (poses.head_tracked ? 1U : 0U) | (poses.left_tracked ? 2U : 0U) |
                                   (poses.right_tracked ? 4U : 0U));
  append<std::uint32_t>(bytes, 0);
  for (const PoseNumbers& row : {poses.head, poses.left, poses.right}) {
    for (const double value : row) append(bytes, value);
  }
  for (const InputNumbers& row : {poses.left_inputs, poses.right_inputs}) {
    for (const double value : row) append(bytes, value);
  }
  return bytes;
}

inline std::string resetRecord(std::uint32_t app, std::uint32_t seed, std::int64_t time_ns,
                               const TrackedPoses& poses) {
  std::string bytes;
  append(bytes, app);
  append(bytes, seed);
  append(bytes, time_ns);
  return bytes + poseBlock(poses);
}

inline std::string stepRecord(std::uint32_t app, std::uint32_t frames, std::int32_t drawn = -1) {
  std::string bytes;
  append(bytes, app);
  append(bytes, frames);
  append(bytes, drawn);
  append<std::uint32_t>(bytes, 0);
  return bytes;
}

inline std::string stepFrame(std::int64_t time_ns, const TrackedPoses& poses) {
  std::string bytes;
  append(bytes, time_ns);
  return bytes + poseBlock(poses);
}

inline std::string appIndex(std::uint32_t app) {
  std::string bytes;
  append(bytes, app);
  return bytes;
}

/// A whole message of protocol 2.
inline Reply message2(protocol2::Type type, std::uint32_t count, std::vector<std::string> frames,
                      std::uint32_t sequence = 7) {
  const protocol2::Header header{
      .type = static_cast<std::uint16_t>(type), .sequence = sequence, .count = count};
  frames.insert(frames.begin(), protocol2::encodeHeader(header));
  return frames;
}

inline std::vector<std::string_view> views(const Reply& frames) {
  return {frames.begin(), frames.end()};
}

/// Bytes of a result record.
inline constexpr std::size_t kResultBytes = 40;

/// What a round gives, whichever way it was played.
struct Played {
  std::vector<float> rewards;
  std::vector<bool> finished;
  std::vector<float> time_features;
  std::vector<std::map<std::string, double>> logs;
  std::vector<std::vector<std::uint8_t>> images;
  std::uint64_t state_hash = 0;

  void add(float reward, bool is_finished, float time_feature,
           const std::map<std::string, double>& log, std::vector<std::uint8_t> image) {
    rewards.push_back(reward);
    finished.push_back(is_finished);
    time_features.push_back(time_feature);
    logs.push_back(log);
    images.push_back(std::move(image));
  }
  bool operator==(const Played&) const = default;
};

inline runtime::AppSettings appSettings() {
  runtime::AppSettings settings;
  settings.options_json = R"({"condition": "hard"})";
  return settings;
}

/// Frames 0 to `frames` of the player's round in process.
inline Played playInProcess(int frames, std::uint32_t seed,
                            const std::shared_ptr<render::Renderer>& renderer) {
  runtime::App app(appSettings(), renderer);
  Played played;
  const auto add = [&](const runtime::StepResult& result) {
    played.add(result.reward, result.finished, result.time_feature, result.log,
               {app.image().begin(), app.image().end()});
  };
  add(app.reset({.seed = seed}, playerPoses(0).devices()));
  for (int n = 1; n <= frames; ++n) add(app.step({frameNs(n), playerPoses(n).devices()}));
  played.state_hash = app.stateHash();
  return played;
}

}  // namespace sim2vr::server::testing

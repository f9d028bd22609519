// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/rl/episode_logger.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <system_error>
#include <utility>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"

namespace sim2vr::rl {
namespace {

void open(std::ofstream& file, const std::filesystem::path& path) {
  file = std::ofstream(path, std::ios::binary | std::ios::trunc);
  if (!file) {
    throw EngineError("episode log: cannot write " + path.string() +
                      "; check that the log directory exists and is writable");
  }
}

void close(std::ofstream& file, const std::filesystem::path& path) {
  if (!file.is_open()) return;
  file.close();
  if (file.fail()) {
    throw EngineError("episode log: " + path.string() + " is incomplete; is the disk full?");
  }
}

}  // namespace

std::string formatFloat(double value) {
  const auto single = static_cast<float>(value);
  if (std::isnan(single)) return "NaN";
  if (std::isinf(single)) return single > 0.0F ? "Infinity" : "-Infinity";
  if (single == 0.0F) return "0";
  std::string text = fmt::format("{}", single);
  std::replace(text.begin(), text.end(), 'e', 'E');
  return text;
}

std::string formatVector(const Vec3& vector) {
  return formatFloat(vector.x()) + " " + formatFloat(vector.y()) + " " + formatFloat(vector.z());
}

std::string formatPose(const Pose& pose) {
  const Quat& q = pose.rotation;
  return formatVector(pose.position) + " " + formatFloat(q.x()) + " " + formatFloat(q.y()) + " " +
         formatFloat(q.z()) + " " + formatFloat(q.w());
}

EpisodeLogger::EpisodeLogger(std::filesystem::path root) : root_(std::move(root)) {}

EpisodeLogger::~EpisodeLogger() {
  try {
    endRound();
  } catch (const std::exception& error) {
    logger().error("{}", error.what());
  }
}

void EpisodeLogger::beginRound(std::string_view condition, std::uint32_t seed,
                               std::span<const std::string> pose_names) {
  endRound();
  folder_ = root_ / fmt::format("{:04d}-{}", round_index_, condition);
  std::error_code problem;
  std::filesystem::create_directories(folder_, problem);
  if (problem) {
    throw EngineError("episode log: cannot make the folder " + folder_.string() + ": " +
                      problem.message());
  }
  open(states_, folder_ / "states.csv");
  open(events_, folder_ / "events.csv");
  ++round_index_;
  pose_count_ = pose_names.size();
  states_ << "condition " << condition << ", random seed " << seed << "\ntimestamp";
  for (const std::string& name : pose_names) {
    for (const char* axis : {"pos_x", "pos_y", "pos_z", "quat_x", "quat_y", "quat_z", "quat_w"}) {
      states_ << ", " << name << "_" << axis;
    }
  }
  states_ << "\n";
}

void EpisodeLogger::state(float time_s, std::span<const Pose> poses) {
  if (!inRound()) return;
  if (poses.size() != pose_count_) {
    throw InvalidArgument("poses", std::to_string(poses.size()) + " poses",
                          std::to_string(pose_count_) + ", as named in beginRound");
  }
  std::string row = formatFloat(time_s);
  for (const Pose& pose : poses) row += ", " + formatPose(pose);
  // The columns of a pose are separated like those of different poses.
  std::string columns;
  for (std::size_t i = 0; i < row.size(); ++i) {
    if (row[i] == ' ' && row[i - 1] != ',') columns += ',';
    columns += row[i];
  }
  states_ << columns << "\n";
}

void EpisodeLogger::event(float time_s, std::string_view text) {
  if (!inRound()) return;
  events_ << formatFloat(time_s) << ", " << text << "\n";
}

void EpisodeLogger::endRound() {
  // Both files are closed before the first failure is reported.
  std::exception_ptr failure;
  const std::pair<std::ofstream*, const char*> files[] = {{&states_, "states.csv"},
                                                          {&events_, "events.csv"}};
  for (const auto& [file, name] : files) {
    try {
      close(*file, folder_ / name);
    } catch (...) {
      failure = std::current_exception();
    }
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace sim2vr::rl

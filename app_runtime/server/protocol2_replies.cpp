// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "sim2vr/core/text.hpp"
#include "sim2vr/core/version.hpp"
#include "sim2vr/server/protocol2.hpp"

namespace sim2vr::server::protocol2 {
namespace {

using Json = nlohmann::json;
using wire::append;

Header replyHeader(const Header& request) {
  return {.version = kVersion,
          .type = static_cast<std::uint16_t>(request.type | kReplyBit),
          .sequence = request.sequence};
}

std::string text(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void append(std::string& bytes, const xr::HapticPulse& pulse) {
  append<std::uint32_t>(bytes, static_cast<std::uint32_t>(pulse.hand));
  append<float>(bytes, pulse.amplitude);
  append<float>(bytes, pulse.frequency_hz);
  append<std::uint32_t>(bytes, 0);
  append<std::int64_t>(bytes, pulse.duration_ns);
}

void append(std::string& bytes, const rl::SoundEvent& sound, std::uint32_t name) {
  append<std::uint32_t>(bytes, name);
  append<float>(bytes, sound.gain);
  for (const double coordinate : sound.position_m) append<double>(bytes, coordinate);
}

std::uint32_t size32(std::size_t size) { return static_cast<std::uint32_t>(size); }

void appendRecord(std::string& bytes, const Result& result, std::uint32_t names) {
  append<std::uint32_t>(bytes, result.app);
  append<std::uint32_t>(bytes, result.step.finished ? 1 : 0);
  append<float>(bytes, result.step.reward);
  append<float>(bytes, result.step.time_feature);
  append<std::uint32_t>(bytes, static_cast<std::uint32_t>(result.status));
  append<std::uint32_t>(bytes, size32(result.step.log.size()));
  append<std::uint32_t>(bytes, names);
  append<std::uint32_t>(bytes, size32(result.step.events.haptics.size()));
  append<std::uint32_t>(bytes, size32(result.step.events.sounds.size()));
  append<std::uint32_t>(bytes, 0);
}

}  // namespace

std::uint32_t Names::ofLog(const std::map<std::string, double>& log) {
  std::vector<std::string> names;
  names.reserve(log.size());
  for (const auto& entry : log) names.push_back(entry.first);
  const auto [found, added] = logs_.emplace(std::move(names), size32(logs_.size()));
  if (added) new_logs_.push_back(&found->first);
  return found->second;
}

std::uint32_t Names::ofSound(const std::string& name) {
  const auto [found, added] = sounds_.emplace(name, size32(sounds_.size()));
  if (added) new_sounds_.push_back(&found->first);
  return found->second;
}

std::string Names::takeNew() {
  if (new_logs_.empty() && new_sounds_.empty()) return {};
  Json logs = Json::object();
  Json sounds = Json::object();
  for (const std::vector<std::string>* names : new_logs_) {
    logs[std::to_string(logs_.at(*names))] = *names;
  }
  for (const std::string* name : new_sounds_) sounds[std::to_string(sounds_.at(*name))] = *name;
  new_logs_.clear();
  new_sounds_.clear();
  return text({{"logs", std::move(logs)}, {"sounds", std::move(sounds)}});
}

Reply encodeResults(const Header& request, const std::vector<Result>& results, Names& names) {
  std::string records;
  std::string values;
  std::string haptics;
  std::string sounds;
  Json errors = Json::array();
  for (const Result& result : results) {
    if (result.status != Status::ok) errors.push_back(result.error);
    appendRecord(records, result, names.ofLog(result.step.log));
    for (const auto& entry : result.step.log) append<double>(values, entry.second);
    for (const xr::HapticPulse& pulse : result.step.events.haptics) append(haptics, pulse);
    for (const rl::SoundEvent& sound : result.step.events.sounds) {
      append(sounds, sound, names.ofSound(sound.name));
    }
  }
  Header header = replyHeader(request);
  header.count = size32(results.size());
  std::string error_text = errors.empty() ? "" : text(errors);
  return {encodeHeader(header),  std::move(records), std::move(values), names.takeNew(), "",
          std::move(error_text), std::move(haptics), std::move(sounds)};
}

Reply encodeReply(const Header& request) { return {encodeHeader(replyHeader(request))}; }

Reply encodeReply(const Header& request, std::string frame) {
  return {encodeHeader(replyHeader(request)), std::move(frame)};
}

Reply encodeError(const Header& request, Status status, std::string_view message) {
  Header header = replyHeader(request);
  header.status = static_cast<std::uint32_t>(status);
  return {encodeHeader(header), validUtf8(message)};
}

Reply encodeOtherVersion(const Header& request) {
  return encodeError(
      request, Status::version_not_supported,
      fmt::format("version: got messages of version {}, expected {}, that of sim2vr-app {}; take "
                  "client and app from the same release",
                  request.version, kVersion, version()));
}

Reply encodeScene(const Header& request, const std::vector<render::Shown>& shown,
                  const std::vector<const render::Mesh*>& new_meshes) {
  Json objects = Json::array();
  for (const render::Shown& each : shown) {
    const auto& rotation = each.pose.rotation.coeffs();
    objects.push_back({{"id", each.object},
                       {"path", each.path},
                       {"layer", each.layer},
                       {"mesh", each.mesh},
                       {"pose",
                        {each.pose.position.x(), each.pose.position.y(), each.pose.position.z(),
                         rotation.x(), rotation.y(), rotation.z(), rotation.w()}},
                       {"scale", {each.scale.x(), each.scale.y(), each.scale.z()}},
                       {"color", {each.color.r, each.color.g, each.color.b, each.color.a}},
                       {"unlit", each.unlit}});
  }
  Json meshes = Json::array();
  std::string numbers;
  for (const render::Mesh* mesh : new_meshes) {
    meshes.push_back({{"name", mesh->name},
                      {"vertices", mesh->vertices.size()},
                      {"triangles", mesh->triangleCount()}});
    for (const render::Vertex& vertex : mesh->vertices) {
      for (const float coordinate : vertex.position) append<float>(numbers, coordinate);
    }
    for (const std::uint32_t index : mesh->indices) append<std::uint32_t>(numbers, index);
  }
  return {encodeHeader(replyHeader(request)),
          text({{"objects", std::move(objects)}, {"meshes", std::move(meshes)}}),
          std::move(numbers)};
}

std::string encodeHash(std::uint64_t hash) {
  std::string bytes;
  append(bytes, hash);
  return bytes;
}

std::string encodeHeadRequest(std::optional<double> pitch_deg) {
  return text({{"pitch_deg", pitch_deg ? Json(*pitch_deg) : Json()}});
}

}  // namespace sim2vr::server::protocol2

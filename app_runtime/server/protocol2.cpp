// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/server/protocol2.hpp"

#include <fmt/format.h>
#include <limits>
#include <nlohmann/json.hpp>
#include <type_traits>

#include "sim2vr/core/json_reader.hpp"
#include "sim2vr/core/text.hpp"
#include "sim2vr/core/version.hpp"

namespace sim2vr::server::protocol2 {
namespace {

using Json = nlohmann::json;
using wire::append;
using wire::Reader;

constexpr std::size_t kHeaderBytes = 24;
constexpr std::size_t kResetBytes = 400;
constexpr std::size_t kStepBytes = 16;
constexpr std::size_t kFrameBytes = 392;
constexpr std::size_t kAppBytes = 4;

constexpr std::uint32_t kHeadBit = 1;
constexpr std::uint32_t kLeftBit = 2;
constexpr std::uint32_t kRightBit = 4;

[[noreturn]] void refuse(const std::string& field, const std::string& got,
                         const std::string& expected) {
  throw MalformedMessage(field + ": got " + got + ", expected " + expected);
}

void checkSize(const char* frame, std::string_view bytes, std::uint64_t expected) {
  if (bytes.size() == expected) return;
  refuse(frame, std::to_string(bytes.size()) + " bytes", std::to_string(expected) + " bytes");
}

void checkFrames(Frames body, std::size_t expected, const char* what) {
  if (body.size() == expected) return;
  refuse(what, std::to_string(body.size()) + " frames",
         std::to_string(expected) + " with the header");
}

TrackedPoses takePoses(Reader& reader) {
  TrackedPoses poses;
  const auto tracked = reader.take<std::uint32_t>();
  reader.skip(4);
  poses.head_tracked = (tracked & kHeadBit) != 0;
  poses.left_tracked = (tracked & kLeftBit) != 0;
  poses.right_tracked = (tracked & kRightBit) != 0;
  for (PoseNumbers* row : {&poses.head, &poses.left, &poses.right}) reader.take(*row);
  for (InputNumbers* row : {&poses.left_inputs, &poses.right_inputs}) reader.take(*row);
  return poses;
}

template <class T>
std::optional<T> optionalNumber(const JsonFields& fields, const char* name) {
  if (!fields.has(name)) return std::nullopt;
  if constexpr (std::is_integral_v<T>) {
    return static_cast<T>(fields.integer(name, 0, 1, render::kMaxImageEdge));
  } else {
    return fields.number(name, 0.0);
  }
}

std::optional<std::string> optionalText(const JsonFields& fields, const char* name) {
  if (!fields.has(name)) return std::nullopt;
  return fields.text(name, "");
}

Hello decodeHello(Frames body) {
  checkFrames(body, 2, "hello");
  const Json json = parseJson(body[1], "hello");
  const JsonFields fields(json, "hello");
  fields.expectOnly({"client", "apps", "game", "options", "width", "height", "renderer", "log_dir",
                     "fixed_delta_time_s", "maximum_delta_time_s", "fixed_step_tolerance_s",
                     "shared_memory", "eyes", "ipd_m", "capabilities"});
  Hello hello;
  hello.client = fields.text("client", hello.client);
  hello.apps = static_cast<std::uint32_t>(fields.integer("apps", 1, 1, kMaximumApps));
  hello.game = optionalText(fields, "game");
  hello.options_json = fields.objectText("options");
  hello.width = optionalNumber<int>(fields, "width");
  hello.height = optionalNumber<int>(fields, "height");
  hello.renderer = optionalText(fields, "renderer");
  hello.log_dir = optionalText(fields, "log_dir");
  hello.fixed_delta_time_s = optionalNumber<double>(fields, "fixed_delta_time_s");
  hello.maximum_delta_time_s = optionalNumber<double>(fields, "maximum_delta_time_s");
  hello.fixed_step_tolerance_s = optionalNumber<double>(fields, "fixed_step_tolerance_s");
  hello.shared_memory = fields.flag("shared_memory");
  if (fields.has("eyes")) hello.eyes = static_cast<int>(fields.integer("eyes", 1, 1, 2));
  hello.ipd_m = optionalNumber<double>(fields, "ipd_m");
  if (fields.has("capabilities")) hello.capabilities = fields.texts("capabilities");
  return hello;
}

HeadRequest decodeHeadRequest(Frames body) {
  checkFrames(body, 2, "head request");
  const Json json = parseJson(body[1], "head_request");
  const JsonFields fields(json, "head_request");
  fields.expectOnly({"app", "seed", "options"});
  HeadRequest request;
  request.app = static_cast<std::uint32_t>(fields.integer("app", 0, 0, kMaximumApps - 1));
  request.seed = static_cast<std::uint32_t>(
      fields.integer("seed", 0, 0, std::numeric_limits<std::uint32_t>::max()));
  request.options_json = fields.objectText("options");
  return request;
}

SceneRequest decodeSceneRequest(Frames body) {
  checkFrames(body, 2, "scene");
  const Json json = parseJson(body[1], "scene");
  const JsonFields fields(json, "scene");
  fields.expectOnly({"app", "meshes"});
  SceneRequest request;
  request.app = static_cast<std::uint32_t>(fields.integer("app", 0, 0, kMaximumApps - 1));
  request.meshes =
      static_cast<int>(fields.integer("meshes", 0, 0, std::numeric_limits<std::int32_t>::max()));
  return request;
}

/// The options of each record; an empty frame means none.
std::vector<std::string> decodeOptions(std::string_view frame, std::size_t count) {
  std::vector<std::string> options(count, "{}");
  if (frame.empty()) return options;
  // An array has no name for itself, so it becomes a field of an object.
  const std::string wrapped = R"({"options":)" + std::string(frame) + "}";
  const Json json = parseJson(wrapped, "reset");
  const JsonFields fields(json, "reset");
  fields.expectOnly({"options"});
  if (fields.objects("options").size() != count) {
    refuse("reset.options", std::to_string(fields.objects("options").size()) + " objects",
           std::to_string(count) + ", one per record");
  }
  for (std::size_t i = 0; i < count; ++i) options[i] = json["options"][i].dump();
  return options;
}

Reset decodeReset(const Header& header, Frames body) {
  checkFrames(body, 3, "reset");
  checkSize("reset records", body[1], std::uint64_t{header.count} * kResetBytes);
  const std::vector<std::string> options = decodeOptions(body[2], header.count);
  Reader reader(body[1]);
  Reset reset;
  reset.records.resize(header.count);
  for (std::size_t i = 0; i < reset.records.size(); ++i) {
    ResetRecord& record = reset.records[i];
    record.app = reader.take<std::uint32_t>();
    record.seed = reader.take<std::uint32_t>();
    record.time_ns = reader.take<std::int64_t>();
    record.poses = takePoses(reader);
    record.options_json = options[i];
  }
  return reset;
}

Step decodeStep(const Header& header, Frames body) {
  checkFrames(body, 3, "step");
  checkSize("step records", body[1], std::uint64_t{header.count} * kStepBytes);
  std::uint64_t frames = 0;
  Reader counts(body[1]);
  for (std::uint32_t i = 0; i < header.count; ++i) {
    counts.skip(4);
    const auto own = counts.take<std::uint32_t>();
    counts.skip(8);
    if (own > kMaximumFrames) {
      refuse("step frames", std::to_string(own), std::to_string(kMaximumFrames) + " at most");
    }
    frames += own;
  }
  checkSize("step frames", body[2], frames * kFrameBytes);
  Reader records(body[1]);
  Reader reader(body[2]);
  Step step;
  step.records.resize(header.count);
  for (StepRecord& record : step.records) {
    record.app = records.take<std::uint32_t>();
    record.frames.resize(records.take<std::uint32_t>());
    record.drawn = records.take<std::int32_t>();
    records.skip(4);
    for (TimedPoses& frame : record.frames) {
      frame.time_ns = reader.take<std::int64_t>();
      frame.poses = takePoses(reader);
    }
  }
  return step;
}

std::uint32_t decodeApp(const char* frame, std::string_view bytes) {
  checkSize(frame, bytes, kAppBytes);
  return Reader(bytes).take<std::uint32_t>();
}

PictureRequest decodeRender(Frames body) {
  if (body.size() != 3) checkFrames(body, 2, "render");
  const Json json = parseJson(body[1], "render");
  const JsonFields fields(json, "render");
  fields.expectOnly({"app", "view", "width", "height"});
  PictureRequest request;
  request.app = static_cast<std::uint32_t>(fields.integer("app", 0, 0, kMaximumApps - 1));
  request.view = fields.text("view", request.view);
  request.size.width =
      static_cast<int>(fields.integer("width", request.size.width, 1, render::kMaxImageEdge));
  request.size.height =
      static_cast<int>(fields.integer("height", request.size.height, 1, render::kMaxImageEdge));
  if (body.size() == 3) {
    checkSize("render observer", body[2], sizeof(*request.observer));
    Reader(body[2]).take(request.observer.emplace());
  }
  return request;
}

Request readRequest(const Header& header, Frames body) {
  switch (static_cast<Type>(header.type)) {
    case Type::hello:
      return decodeHello(body);
    case Type::reset:
      return decodeReset(header, body);
    case Type::step:
      return decodeStep(header, body);
    case Type::render:
      return decodeRender(body);
    case Type::save:
      checkFrames(body, 2, "save");
      return Save{decodeApp("save app", body[1])};
    case Type::load:
      checkFrames(body, 3, "load");
      return Load{decodeApp("load app", body[1]), std::string(body[2])};
    case Type::hash:
      checkFrames(body, 2, "hash");
      return Hash{decodeApp("hash app", body[1])};
    case Type::quit:
      checkFrames(body, 1, "quit");
      return Quit{};
    case Type::head_request:
      return decodeHeadRequest(body);
    case Type::scene:
      return decodeSceneRequest(body);
  }
  refuse("header type", std::to_string(header.type), "a request, 1 to 10");
}

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

bool isProtocol2(Frames body) { return !body.empty() && body[0].starts_with(kMagic); }

Header decodeHeader(std::string_view frame) {
  if (!frame.starts_with(kMagic)) refuse("header", "another start", "the bytes S2VR");
  checkSize("header", frame, kHeaderBytes);
  Reader reader(frame.substr(kMagic.size()));
  Header header;
  header.version = reader.take<std::uint16_t>();
  header.type = reader.take<std::uint16_t>();
  header.sequence = reader.take<std::uint32_t>();
  header.count = reader.take<std::uint32_t>();
  header.status = reader.take<std::uint32_t>();
  header.flags = reader.take<std::uint32_t>();
  return header;
}

std::string encodeHeader(const Header& header) {
  std::string bytes(kMagic);
  append(bytes, header.version);
  append(bytes, header.type);
  append(bytes, header.sequence);
  append(bytes, header.count);
  append(bytes, header.status);
  append(bytes, header.flags);
  return bytes;
}

Request decodeRequest(const Header& header, Frames body) {
  return decoded([&] { return readRequest(header, body); });
}

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

// SPDX-License-Identifier: Apache-2.0
// Protocol 2: binary multipart messages, several apps in one. app_runtime/server/protocol2.md is
// the specification.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "sim2vr/server/message.hpp"

namespace sim2vr::server::protocol2 {

inline constexpr std::string_view kMagic = "S2VR";
/// Of the messages. 2, in releases before capabilities, had other records.
inline constexpr std::uint16_t kVersion = 3;
/// Set in the type of a reply.
inline constexpr std::uint16_t kReplyBit = 0x8000;
/// In the flags of a reply: the images are in the shared memory.
inline constexpr std::uint32_t kImagesShared = 1;
/// Of the images in that reply.
inline constexpr std::size_t kImagesFrame = 4;
inline constexpr std::uint32_t kMaximumApps = 1024;

enum class Type : std::uint16_t {
  hello = 1,
  reset = 2,
  step = 3,
  render = 4,
  save = 5,
  load = 6,
  hash = 7,
  quit = 8,
  head_request = 9,
  scene = 10,
};

enum class Status : std::uint32_t {
  ok = 0,
  invalid_argument = 1,
  state_error = 2,
  engine_error = 3,
  malformed_message = 4,
  busy = 5,
  version_not_supported = 6,
  unsupported = 7,
};

/// Frame 0 of every message: 24 bytes.
struct Header {
  std::uint16_t version = kVersion;
  std::uint16_t type = 0;
  std::uint32_t sequence = 0;
  std::uint32_t count = 0;
  std::uint32_t status = 0;
  std::uint32_t flags = 0;
};

/// Whether a body is one of protocol 2 (of any version) rather than of protocol 1.
bool isProtocol2(Frames body);

/// Throws MalformedMessage unless the frame is a header.
Header decodeHeader(std::string_view frame);
std::string encodeHeader(const Header& header);

/// What a client asks for at the start; what is missing is the command line's affair.
struct Hello {
  std::string client = "?";
  std::uint32_t apps = 1;
  std::optional<std::string> game;
  std::string options_json = "{}";
  std::optional<int> width;
  std::optional<int> height;
  std::optional<std::string> renderer;
  std::optional<std::string> log_dir;
  std::optional<double> fixed_delta_time_s;
  std::optional<double> maximum_delta_time_s;
  std::optional<double> fixed_step_tolerance_s;
  bool shared_memory = false;
  std::optional<int> eyes;
  std::optional<double> ipd_m;
  /// What the client can take of what comes back; none given: all of it.
  std::optional<std::vector<std::string>> capabilities;
};

struct ResetRecord {
  std::uint32_t app = 0;
  std::uint32_t seed = 0;
  std::int64_t time_ns = 0;
  TrackedPoses poses;
  std::string options_json = "{}";
};

struct StepRecord {
  std::uint32_t app = 0;
  std::vector<TimedPoses> frames;
  /// Which of them is drawn; -1: the last.
  int drawn = -1;
};

struct Reset {
  std::vector<ResetRecord> records;
};
struct Step {
  std::vector<StepRecord> records;
};
struct Save {
  std::uint32_t app = 0;
};
struct Load {
  std::uint32_t app = 0;
  std::string state;
};
struct Hash {
  std::uint32_t app = 0;
};
struct Quit {};
struct HeadRequest {
  std::uint32_t app = 0;
  std::uint32_t seed = 0;
  std::string options_json = "{}";
};

struct SceneRequest {
  std::uint32_t app = 0;
  /// How many meshes the client has already; it gets those from this number on.
  int meshes = 0;
};

using Request = std::variant<Hello, Reset, Step, PictureRequest, Save, Load, Hash, Quit,
                             HeadRequest, SceneRequest>;

/// The message after its header. Throws MalformedMessage.
Request decodeRequest(const Header& header, Frames body);

/// The answer of one app to a reset or step.
struct Result {
  std::uint32_t app = 0;
  Status status = Status::ok;
  runtime::StepResult step;
  std::string error;
};

/// Gives every list of log names and every sound a number, and says which ones are new to the
/// client.
class Names {
 public:
  std::uint32_t ofLog(const std::map<std::string, double>& log);
  std::uint32_t ofSound(const std::string& name);
  /// JSON object {"logs": {"id": [names]}, "sounds": {"id": "name"}} of those since the last call;
  /// empty when there are none.
  std::string takeNew();

 private:
  std::map<std::vector<std::string>, std::uint32_t> logs_;
  std::map<std::string, std::uint32_t> sounds_;
  std::vector<const std::vector<std::string>*> new_logs_;
  std::vector<const std::string*> new_sounds_;
};

/// The reply to a reset or step; frame 4, the images, is left empty for the caller to fill.
Reply encodeResults(const Header& request, const std::vector<Result>& results, Names& names);

Reply encodeReply(const Header& request);
Reply encodeReply(const Header& request, std::string frame);
Reply encodeError(const Header& request, Status status, std::string_view message);
/// The reply to a client of another version.
Reply encodeOtherVersion(const Header& request);
/// JSON object {"pitch_deg": number or null}.
std::string encodeHeadRequest(std::optional<double> pitch_deg);
/// Two frames: JSON object {"objects": [...], "meshes": [...]}, and the meshes' numbers.
Reply encodeScene(const Header& request, const std::vector<render::Shown>& shown,
                  const std::vector<const render::Mesh*>& new_meshes);
/// 8 bytes, little-endian.
std::string encodeHash(std::uint64_t hash);

}  // namespace sim2vr::server::protocol2

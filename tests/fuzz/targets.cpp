// SPDX-License-Identifier: Apache-2.0
#include "targets.hpp"

#include <cstdlib>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/rl/state_log.hpp"
#include "sim2vr/runtime/app.hpp"
#include "sim2vr/server/message.hpp"
#include "sim2vr/server/protocol1.hpp"
#include "sim2vr/server/protocol2.hpp"
#include "sim2vr/server/session.hpp"
#include "sim2vr/xr/pose_row.hpp"

namespace sim2vr::fuzz {
namespace {

using server::Frames;
using server::MalformedMessage;

/// More than this costs time and finds nothing.
constexpr std::size_t kMaximumFrames = 8;
constexpr std::size_t kMaximumPicturePixels = 64 * 64;
constexpr std::size_t kMaximumMessages = 20;
constexpr std::size_t kMessageEnd = 0xFFFF;

/// Errors begin with the field, or the file, before the first colon.
bool namesField(std::string_view message) {
  const std::size_t colon = message.find(": ");
  return colon != std::string_view::npos && colon > 0;
}

/// Runs something that may refuse its input with the decoders' one error.
template <class Work>
void decoding(Work work) {
  try {
    work();
  } catch (const MalformedMessage& error) {
    require(namesField(error.what()), "an error names its field");
  }
}

/// Picture sizes, numbers of frames and of apps are bounded by the server, but at a scale of
/// seconds.
bool costly(const server::protocol1::State& state) {
  return state.frames.size() > kMaximumFrames ||
         (state.render && state.render->size.pixels() > kMaximumPicturePixels);
}

bool costly(const server::protocol2::Request& request) {
  if (const auto* hello = std::get_if<server::protocol2::Hello>(&request)) {
    return hello->apps > 2 || hello->width.value_or(8) > 64 || hello->height.value_or(8) > 64 ||
           hello->renderer.value_or("null") != "null";
  }
  if (const auto* picture = std::get_if<server::PictureRequest>(&request)) {
    return picture->size.pixels() > kMaximumPicturePixels;
  }
  if (const auto* step = std::get_if<server::protocol2::Step>(&request)) {
    for (const auto& record : step->records) {
      if (record.frames.size() > kMaximumFrames) return true;
    }
  }
  return false;
}

}  // namespace

void require(bool holds, const char* what) {
  if (holds) return;
  std::cerr << "contradiction: " << what << "\n";
  std::abort();
}

std::vector<std::string_view> takeFrames(std::string_view& input) {
  std::vector<std::string_view> frames;
  while (input.size() >= 2) {
    const std::size_t length =
        static_cast<unsigned char>(input[0]) | static_cast<unsigned char>(input[1]) << 8U;
    input.remove_prefix(2);
    if (length == kMessageEnd) break;
    frames.push_back(input.substr(0, length));
    input.remove_prefix(frames.back().size());
  }
  if (input.size() < 2) input = {};
  return frames;
}

server::HostSettings hostSettings() {
  logger().set_level(spdlog::level::off);
  server::HostSettings settings;
  settings.app.options_json = R"({"condition": "hard"})";
  settings.app.headset_size = {8, 6};
  settings.renderer = "null";
  settings.fixed_seed = 1;
  // Clients may not name folders.
  settings.local = false;
  return settings;
}

runtime::AppSettings beatsSettings() {
  runtime::AppSettings settings = hostSettings().app;
  settings.game = "beats";
  settings.options_json = R"({"level": "generated", "level_seconds": 10, "reward": "shaped"})";
  return settings;
}

void protocol1(std::string_view input) {
  decoding([&] {
    const auto handshake = server::protocol1::decodeHandshake(input);
    require(handshake.sample_frequency_hz >= 1 && handshake.fixedStep_s() > 0.0, "a handshake");
  });
  decoding([&] {
    const auto state = server::protocol1::decodeState(input);
    require(state.poses.head_tracked, "a state");
  });
}

void protocol2(std::string_view input) {
  const std::vector<std::string_view> body = takeFrames(input);
  if (body.empty()) return;
  decoding([&] {
    const auto header = server::protocol2::decodeHeader(body[0]);
    require(server::protocol2::encodeHeader(header) == body[0], "a header");
    const auto request = server::protocol2::decodeRequest(header, body);
    if (const auto* step = std::get_if<server::protocol2::Step>(&request)) {
      require(step->records.size() == header.count, "a step");
    }
  });
}

void base64(std::string_view input) {
  decoding([&] { require(server::encodeBase64(server::decodeBase64(input)) == input, "base64"); });
  require(server::decodeBase64(server::encodeBase64(input)) == input, "base64 of bytes");
}

void stateLog(std::string_view input) {
  try {
    const rl::StateLog log = rl::parseStateLog(input);
    require(!log.rows.empty(), "a state log");
  } catch (const InvalidArgument& error) {
    require(!error.field().empty(), "an error names its field");
  }
}

void session1(std::string_view input) {
  static server::AppHost host(hostSettings());
  const std::string_view handshake = R"({"timestep":0.002,"sampleFrequency":20,"timeScale":1})";
  const auto session = server::openSession(host, Frames(&handshake, 1)).session;
  for (std::size_t i = 0; i < kMaximumMessages && !input.empty() && !session->over(); ++i) {
    const std::size_t end = std::min(input.find('\0'), input.size());
    const std::string_view message = input.substr(0, end);
    input.remove_prefix(std::min(end + 1, input.size()));
    bool skipped = false;
    decoding([&] { skipped = costly(server::protocol1::decodeState(message)); });
    if (!skipped) require(!session->answer(Frames(&message, 1)).empty(), "an answer");
  }
}

void session2(std::string_view input) {
  static server::AppHost host(hostSettings());
  const std::string header = server::protocol2::encodeHeader({.type = 1});
  const std::vector<std::string_view> hello{header, R"({"apps": 2})"};
  const auto session = server::openSession(host, hello).session;
  for (std::size_t i = 0; i < kMaximumMessages && !input.empty() && !session->over(); ++i) {
    const std::vector<std::string_view> body = takeFrames(input);
    bool skipped = false;
    decoding([&] {
      if (body.empty()) return;
      const auto head = server::protocol2::decodeHeader(body[0]);
      skipped = costly(server::protocol2::decodeRequest(head, body));
    });
    if (!skipped) require(!session->answer(body).empty(), "an answer");
  }
}

namespace {

/// Loads a state, plays on, and saves and loads again.
void loadAndPlay(const runtime::AppSettings& settings, std::string_view input) {
  static const auto renderer = render::Renderer::create(render::RendererKind::null);
  runtime::App app(settings, renderer);
  try {
    app.load(std::string(input));
  } catch (const EngineError& error) {
    require(std::string_view(error.what()).starts_with("saved state: "), "an error names its file");
    return;
  }
  constexpr double kHead[] = {0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0};
  constexpr std::int64_t kSecond_ns = 1'000'000'000;
  try {
    app.step({kSecond_ns, xr::devicesFromRows(kHead, nullptr, nullptr)});
  } catch (const StateError&) {       // the round is over
  } catch (const InvalidArgument&) {  // it is past that second
  }
  const std::string again = app.save();
  app.load(again);
  require(app.save() == again, "a saved state");
}

}  // namespace

void savedState(std::string_view input) { loadAndPlay(hostSettings().app, input); }

void savedBeats(std::string_view input) { loadAndPlay(beatsSettings(), input); }

}  // namespace sim2vr::fuzz

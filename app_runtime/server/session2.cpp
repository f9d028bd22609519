#include "session2.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>
#include <variant>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/core/options.hpp"
#include "sim2vr/core/text.hpp"
#include "sim2vr/core/version.hpp"

namespace sim2vr::server {
namespace {

using protocol2::Result;
using protocol2::Status;

constexpr std::size_t kMaximumImageBytes = std::size_t{512} << 20;

void checkMemory(const runtime::AppSettings& settings, std::uint32_t apps) {
  render::checkImageSize(settings.headset_size);
  if (settings.imageBytes() * apps <= kMaximumImageBytes) return;
  const render::ImageSize size = settings.headset_size;
  throw InvalidArgument("apps",
                        std::to_string(apps) + " of " + std::to_string(size.width) + " x " +
                            std::to_string(size.height) + " pixels",
                        std::to_string(kMaximumImageBytes >> 20) + " MiB of images at most");
}

/// Of hello's list; a client that sends none takes everything.
bool takes(const protocol2::Hello& hello, runtime::Capability capability) {
  if (!hello.capabilities) return true;
  const std::string_view name = runtime::capabilityName(capability);
  return std::find(hello.capabilities->begin(), hello.capabilities->end(), name) !=
         hello.capabilities->end();
}

/// Names of what the app can do over this protocol, which has no message for privileged numbers.
std::vector<std::string> capabilityNames(const runtime::LockstepApp& app) {
  std::vector<std::string> names;
  for (const runtime::Capability capability : app.capabilities()) {
    if (capability != runtime::Capability::privileged) {
      names.emplace_back(runtime::capabilityName(capability));
    }
  }
  return names;
}

std::string asString(std::span<const std::uint8_t> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

}  // namespace

Session2::Session2(AppHost& host)
    : host_(host),
      workers_(host.settings().threads),
      pacer_(host.settings().realtime,
             host.settings().time_scale > 0.0 ? host.settings().time_scale : 1.0) {}

Reply Session2::answer(Frames body) {
  Header header;
  try {
    if (!protocol2::isProtocol2(body)) {
      throw StateError("message: got one of protocol 1, this session speaks protocol 2");
    }
    header = protocol2::decodeHeader(body[0]);
    if (header.version != protocol2::kVersion) {
      return protocol2::encodeOtherVersion(header);
    }
    return answerRequest(header, protocol2::decodeRequest(header, body));
  } catch (...) {
    return errorReply(body, currentProblem());
  }
}

Reply Session2::answerRequest(const Header& header, const protocol2::Request& request) {
  if (!open() && !std::holds_alternative<protocol2::Hello>(request)) {
    throw StateError("message: got one before hello, expected hello first");
  }
  return std::visit([&](const auto& asked) { return respond(header, asked); }, request);
}

Reply Session2::respond(const Header& header, const protocol2::Reset& reset) {
  return playAll(header, reset.records);
}

Reply Session2::respond(const Header& header, const protocol2::Step& step) {
  return playAll(header, step.records);
}

Reply Session2::respond(const Header& header, const PictureRequest& picture) {
  return protocol2::encodeReply(header, asString(drawPicture(app(picture.app).app(), picture)));
}

Reply Session2::respond(const Header& header, const protocol2::Save& save) {
  return protocol2::encodeReply(header, app(save.app).app().save());
}

Reply Session2::respond(const Header& header, const protocol2::Load& load) {
  runtime::LockstepApp& loaded = app(load.app).app();
  loaded.load(load.state);
  if (shared_ != nullptr) shared_->write(load.app, loaded.image());
  return protocol2::encodeReply(header, asString(loaded.image()));
}

Reply Session2::respond(const Header& header, const protocol2::Hash& hash) {
  const std::uint64_t value = app(hash.app).app().stateHash();
  return protocol2::encodeReply(header, protocol2::encodeHash(value));
}

Reply Session2::respond(const Header& header, const protocol2::Quit&) {
  over_ = true;
  return protocol2::encodeReply(header);
}

Reply Session2::respond(const Header& header, const protocol2::HeadRequest& request) {
  const std::optional<double> pitch_deg =
      app(request.app)
          .app()
          .headRequest({.seed = request.seed, .options_json = request.options_json});
  return protocol2::encodeReply(header, protocol2::encodeHeadRequest(pitch_deg));
}

Reply Session2::respond(const Header& header, const protocol2::SceneRequest& request) {
  runtime::LockstepApp& asked = app(request.app).app();
  const std::vector<render::Shown> shown = asked.shown();
  int known = 0;
  for (const render::Shown& each : shown) known = std::max(known, each.mesh + 1);
  std::vector<const render::Mesh*> new_meshes;
  for (int number = request.meshes; number < known; ++number) {
    new_meshes.push_back(&asked.shownMesh(number));
  }
  return protocol2::encodeScene(header, shown, new_meshes);
}

runtime::AppSettings Session2::appSettings(const protocol2::Hello& hello) const {
  runtime::AppSettings settings = host_.settings().app;
  const bool other_game = hello.game && *hello.game != settings.game;
  if (other_game) {
    settings.game = *hello.game;
    settings.options_json = "{}";
  }
  settings.options_json = mergedOptions(settings.options_json, hello.options_json);
  settings.headset_size = {hello.width.value_or(settings.headset_size.width),
                           hello.height.value_or(settings.headset_size.height)};
  settings.eyes = hello.eyes.value_or(settings.eyes);
  if (hello.ipd_m) settings.ipd_m = static_cast<float>(*hello.ipd_m);
  if (hello.log_dir && !hello.log_dir->empty()) {
    if (!host_.settings().local) {
      throw InvalidArgument("log_dir", "'" + *hello.log_dir + "' from another machine",
                            "none; the server's --log-dir writes logs");
    }
    settings.log_dir = pathFromUri("log_dir", *hello.log_dir);
  }
  TimeSettings& time = settings.time;
  time.fixed_delta_time_s = hello.fixed_delta_time_s.value_or(time.fixed_delta_time_s);
  time.maximum_delta_time_s = hello.maximum_delta_time_s.value_or(time.maximum_delta_time_s);
  time.fixed_step_tolerance_s = hello.fixed_step_tolerance_s.value_or(time.fixed_step_tolerance_s);
  return settings;
}

Reply Session2::respond(const Header& header, const protocol2::Hello& hello) {
  const runtime::AppSettings settings = appSettings(hello);
  const std::string kind = hello.renderer.value_or(host_.settings().renderer);
  checkMemory(settings, hello.apps);
  std::vector<std::unique_ptr<HostedApp>> apps = host_.makeApps(settings, kind, hello.apps);
  std::unique_ptr<wire::SharedImages> shared;
  if (hello.shared_memory && host_.settings().local) {
    shared = wire::SharedImages::create(apps.size(), settings.imageBytes());
  }
  apps_ = std::move(apps);
  shared_ = std::move(shared);
  names_ = {};
  sends_haptics_ = takes(hello, runtime::Capability::haptics);
  sends_sounds_ = takes(hello, runtime::Capability::sounds);
  logger().info("protocol 2: {} for {}, {} app(s), images through {}", settings.game,
                printable(hello.client), apps_.size(),
                shared_ != nullptr ? "shared memory" : "the socket");
  return protocol2::encodeReply(header, about(settings));
}

std::string Session2::about(const runtime::AppSettings& settings) const {
  runtime::LockstepApp& app = apps_.front()->app();
  nlohmann::json facts;
  if (const auto& tell = host_.settings().facts_json) {
    facts = nlohmann::json::parse(tell(settings.game));
  }
  nlohmann::json shared;
  if (shared_ != nullptr) shared = {{"path", shared_->path()}, {"link", shared_->link()}};
  const nlohmann::json json{{"server", "sim2vr-app"},
                            {"version", version()},
                            {"game", settings.game},
                            {"facts", std::move(facts)},
                            {"capabilities", capabilityNames(app)},
                            {"apps", apps_.size()},
                            {"width", settings.headset_size.width},
                            {"height", settings.headset_size.height},
                            {"eyes", settings.eyes},
                            {"renderer_description", app.rendererDescription()},
                            {"shared_memory", std::move(shared)}};
  return json.dump();
}

HostedApp& Session2::app(std::uint32_t index) {
  checkApps({index});
  return *apps_[index];
}

void Session2::checkApps(const std::vector<std::uint32_t>& indices) const {
  std::vector<bool> seen(apps_.size(), false);
  for (const std::uint32_t index : indices) {
    if (index >= apps_.size()) {
      throw InvalidArgument("app", std::to_string(index),
                            "0 to " + std::to_string(apps_.size() - 1));
    }
    if (seen[index]) {
      throw InvalidArgument("app", std::to_string(index) + " twice", "each app once in a message");
    }
    seen[index] = true;
  }
}

runtime::StepResult Session2::play(const protocol2::ResetRecord& record) {
  checkGameTime(record.time_ns);
  return apps_[record.app]->reset({record.seed, record.options_json, record.time_ns},
                                  record.poses.devices());
}

runtime::StepResult Session2::play(const protocol2::StepRecord& record) {
  return apps_[record.app]->step(frameInputs(record.frames), record.drawn);
}

template <class Record>
Reply Session2::playAll(const Header& header, const std::vector<Record>& records) {
  std::vector<std::uint32_t> indices;
  for (const Record& record : records) indices.push_back(record.app);
  checkApps(indices);
  std::vector<Result> results(records.size());
  workers_.run([&](int worker) {
    for (std::size_t i = 0; i < records.size(); ++i) {
      const std::uint32_t app = records[i].app;
      if (static_cast<int>(app) % workers_.threads() != worker) continue;
      results[i].app = app;
      try {
        results[i].step = play(records[i]);
        if (!sends_haptics_) results[i].step.events.haptics.clear();
        if (!sends_sounds_) results[i].step.events.sounds.clear();
      } catch (...) {
        const Problem problem = currentProblem();
        results[i].status = problem.status;
        results[i].error = problem.message;
      }
    }
  });
  if (!records.empty()) pace(records.front());
  Reply reply = protocol2::encodeResults(header, results, names_);
  addImages(results, reply);
  return reply;
}

void Session2::pace(const protocol2::ResetRecord& record) { pacer_.restart(record.time_ns); }

void Session2::pace(const protocol2::StepRecord& record) {
  if (!record.frames.empty()) pacer_.waitFor(record.frames.back().time_ns);
}

void Session2::addImages(const std::vector<Result>& results, Reply& reply) {
  if (shared_ != nullptr) {
    for (const Result& result : results) {
      shared_->write(result.app, apps_[result.app]->app().image());
    }
    Header header = protocol2::decodeHeader(reply[0]);
    header.flags |= protocol2::kImagesShared;
    reply[0] = protocol2::encodeHeader(header);
    return;
  }
  std::string& images = reply[protocol2::kImagesFrame];
  for (const Result& result : results) {
    const auto image = apps_[result.app]->app().image();
    images.append(reinterpret_cast<const char*>(image.data()), image.size());
  }
}

}  // namespace sim2vr::server

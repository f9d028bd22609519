// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/server/app_host.hpp"

#include <fmt/format.h>

#include <random>
#include <utility>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::server {
namespace {

constexpr double kMaximumFixedSteps = 1e5;

/// Counter-based generator (splitmix64): the n-th number of a key.
std::uint64_t mixed(std::uint64_t key, std::uint64_t n) {
  std::uint64_t z = key + (n + 1) * 0x9E3779B97F4A7C15ULL;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
  return z ^ (z >> 31);
}

std::uint64_t entropy() {
  std::random_device device;
  return static_cast<std::uint64_t>(device()) << 32 | device();
}

std::filesystem::path folderOf(const std::filesystem::path& root, int session, std::uint32_t index,
                               std::uint32_t count) {
  if (root.empty()) return root;
  std::filesystem::path folder = root;
  if (session > 0) folder /= fmt::format("session{:03d}", session);
  if (count > 1) folder /= fmt::format("app{:03d}", index);
  return folder;
}

/// No message may keep the app busy for minutes.
void checkTime(const TimeSettings& time) {
  time.validate();
  if (time.maximum_delta_time_s > kMaximumFixedSteps * time.fixed_delta_time_s) {
    throw InvalidArgument("maximum_delta_time_s", fmt::format("{}", time.maximum_delta_time_s),
                          "100000 fixed steps at most");
  }
}

}  // namespace

HostedApp::HostedApp(std::unique_ptr<runtime::LockstepApp> app,
                     std::optional<runtime::RecorderSettings> recorder)
    : app_(std::move(app)) {
  if (recorder) recorder_ = std::make_unique<runtime::Recorder>(*std::move(recorder));
}

runtime::StepResult HostedApp::reset(const runtime::RoundStart& start,
                                     const xr::DeviceState& devices) {
  runtime::StepResult result = app_->reset(start, devices);
  record();
  return result;
}

runtime::StepResult HostedApp::step(std::span<const runtime::FrameInput> frames, int drawn) {
  runtime::StepResult result = app_->step(frames, drawn);
  record();
  return result;
}

void HostedApp::record() {
  if (recorder_ != nullptr) recorder_->write(*app_);
}

AppHost::AppHost(HostSettings settings) : settings_(std::move(settings)), entropy_(entropy()) {}

std::vector<std::unique_ptr<HostedApp>> AppHost::makeApps(const runtime::AppSettings& settings,
                                                          const std::string& renderer_kind,
                                                          std::uint32_t count) {
  checkTime(settings.time);
  std::vector<std::unique_ptr<HostedApp>> apps;
  for (std::uint32_t i = 0; i < count; ++i) {
    runtime::AppSettings own = settings;
    own.log_dir = folderOf(settings.log_dir, session_, i, count);
    std::optional<runtime::RecorderSettings> recorder = settings_.recorder;
    if (recorder) {
      recorder->folder = folderOf(recorder->folder, session_, i, count);
      recorder->frame_rate = settings.time.target_frame_rate;
    }
    const int worker = static_cast<int>(i) % settings_.threads;
    apps.push_back(std::make_unique<HostedApp>(
        settings_.make_app(own, renderer(renderer_kind, worker), {}), std::move(recorder)));
    apps.back()->app().stopOn(stop_);
  }
  return apps;
}

std::shared_ptr<render::Renderer> AppHost::renderer(const std::string& kind, int worker) {
  std::shared_ptr<render::Renderer>& renderer = renderers_[{kind, worker}];
  if (renderer == nullptr) {
    renderer = render::Renderer::create(render::rendererKindFromName(kind));
  }
  return renderer;
}

std::uint32_t AppHost::nextSeed() {
  if (settings_.fixed_seed != 0) return settings_.fixed_seed;
  return static_cast<std::uint32_t>(mixed(entropy_, drawn_seeds_++) >> 32);
}

}  // namespace sim2vr::server

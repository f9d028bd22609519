// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/runtime/app_batch.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <atomic>
#include <exception>
#include <iterator>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::runtime {
namespace {

int checkedApps(int apps) {
  if (apps < 1) throw InvalidArgument("apps", std::to_string(apps), "1 or more");
  return apps;
}

int checkedThreads(int threads, int apps) {
  if (threads < 1) throw InvalidArgument("threads", std::to_string(threads), "1 or more");
  return std::min(threads, apps);
}

constexpr std::size_t kImageChannels = 4;

void checkChannels(const std::vector<int>& channels) {
  for (const int channel : channels) {
    if (channel < 0 || channel >= static_cast<int>(kImageChannels)) {
      throw InvalidArgument("vision_channels", std::to_string(channel),
                            "0 (red), 1 (green), 2 (blue) or 3 (depth)");
    }
  }
}

/// Apps that a thread takes at a time: enough for a good batch of pictures, few enough that the
/// threads finish together.
std::size_t portionSize(std::size_t apps, int threads) {
  constexpr std::size_t kMost = 8;
  constexpr std::size_t kPortionsPerThread = 4;
  const std::size_t fair = apps / (static_cast<std::size_t>(threads) * kPortionsPerThread);
  return std::clamp<std::size_t>(fair, 1, kMost);
}

/// The failure with the app's index in front.
[[noreturn]] void rethrowOfApp(int index) {
  const std::string app = fmt::format("app {}", index);
  try {
    throw;
  } catch (const InvalidArgument& error) {
    throw InvalidArgument(app + ", " + error.field(), error.got(), error.expected());
  } catch (const RenderError& error) {
    throw RenderError(app + ": " + error.what());
  } catch (const Unsupported&) {
    throw;  // of no app in particular: all are of one kind
  } catch (const StateError& error) {
    throw StateError(app + ": " + error.what());
  } catch (const std::exception& error) {
    throw EngineError(app + ": " + error.what());
  }
}

}  // namespace

AppBatch::AppBatch(const BatchSettings& settings)
    : settings_(settings), pool_(checkedThreads(settings.threads, checkedApps(settings.apps))) {
  settings_.app.validate();
  const auto count = static_cast<std::size_t>(settings_.apps);
  checkChannels(settings_.vision_channels);
  const std::size_t bytes = settings_.app.imageBytes();
  images_.resize(count * bytes);
  vision_.resize(count * bytes / kImageChannels * settings_.vision_channels.size());
  const std::size_t window = settings_.fovea_size.width > 0 ? settings_.fovea_size.pixels() : 0;
  if (window > 0) {
    render::checkImageSize(settings_.fovea_size);
    if (!(settings_.fovea_pixel_m > 0.0F)) {
      throw InvalidArgument("fovea_pixel_m", fmt::format("{}", settings_.fovea_pixel_m), "above 0");
    }
  }
  fovea_.resize(count * window * kImageChannels);
  fovea_depth_.resize(count * window);
  gaze_.resize(2 * count);
  rewards_.resize(count);
  finished_.resize(count);
  time_features_.resize(count);
  haptic_counts_.resize(count);
  sound_counts_.resize(count);
  if (!settings_.log_dirs.empty() && settings_.log_dirs.size() != count) {
    throw InvalidArgument("log_dirs", std::to_string(settings_.log_dirs.size()) + " folders",
                          fmt::format("{}, one for each app, or none", count));
  }
  renderers_ = settings_.renderers;
  const auto wanted = static_cast<std::size_t>(pool_.threads());
  while (renderers_.empty() || (renderers_[0]->drawsOnCpu() && renderers_.size() < wanted)) {
    renderers_.push_back(render::Renderer::create(settings_.renderer));
  }
  renderers_.resize(renderers_[0]->drawsOnCpu() ? wanted : 1);
  for (int i = 0; i < settings_.apps; ++i) {
    AppSettings app = settings_.app;
    app.log_dir.clear();
    if (!settings_.log_dirs.empty()) app.log_dir = settings_.log_dirs[static_cast<std::size_t>(i)];
    const auto image = std::span(images_).subspan(static_cast<std::size_t>(i) * bytes, bytes);
    apps_.push_back(
        settings_.make(app, renderers_[static_cast<std::size_t>(i) % renderers_.size()], image));
  }
  privileged_.resize(count * privilegedNames().size());
  privileged_drawn_.resize(privileged_.size());
}

LockstepApp& AppBatch::app(int index) {
  if (index < 0 || index >= size()) {
    throw InvalidArgument("app", std::to_string(index), fmt::format("0 to {}", size() - 1));
  }
  return *apps_[static_cast<std::size_t>(index)];
}

/// Calls work(worker, begin, end) on all threads until 0 .. count-1 are done.
template <class Work>
void AppBatch::inPortions(std::size_t count, const Work& work) {
  const std::size_t portion = portionSize(count, pool_.threads());
  std::atomic<std::size_t> next = 0;
  pool_.run([&](int worker) {
    while (true) {
      const std::size_t begin = next.fetch_add(portion);
      if (begin >= count) return;
      work(static_cast<std::size_t>(worker), begin, std::min(begin + portion, count));
    }
  });
}

/// Moves the apps at `indices` on all threads: `start(i)` moves the app at indices[i] to the frame
/// that is drawn, `finish(i)` to the end. A thread takes a handful of apps at a time and comes back
/// for more, so that one that is held up by other programs does not hold up the others. With a
/// renderer of its own it draws them, too; a single renderer draws all apps between the two halves.
template <class Start, class Finish>
void AppBatch::run(std::span<const int> indices, const Start& start, const Finish& finish) {
  for (const int index : indices) static_cast<void>(app(index));
  std::vector<Outcome> outcomes(indices.size());
  std::vector<std::exception_ptr> failures(indices.size());
  const auto guarded = [&failures](std::size_t i, const auto& work) {
    if (failures[i]) return;
    try {
      work();
    } catch (...) {
      failures[i] = std::current_exception();
    }
  };
  using Views = std::vector<render::ViewRequest>;
  const auto to_the_picture = [&](std::size_t begin, std::size_t end, Views& views) {
    for (std::size_t i = begin; i < end; ++i) {
      guarded(i, [&] {
        start(i);
        fillPrivileged(indices[i], privileged_drawn_);
        at(indices, i).addViews(views);
        if (!fovea_.empty()) addFovea(indices[i], views);
      });
    }
  };
  const auto to_the_end = [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      guarded(i, [&] {
        separateChannels(indices[i]);
        outcomes[i] = finish(i);
        fillPrivileged(indices[i], privileged_);
      });
    }
  };
  std::vector<Views> views(static_cast<std::size_t>(pool_.threads()));
  if (renderers_[0]->drawsOnCpu()) {
    inPortions(indices.size(), [&](std::size_t worker, std::size_t begin, std::size_t end) {
      views[worker].clear();
      to_the_picture(begin, end, views[worker]);
      renderers_[worker]->renderBatch(views[worker]);
      to_the_end(begin, end);
    });
  } else {
    inPortions(indices.size(), [&](std::size_t worker, std::size_t begin, std::size_t end) {
      to_the_picture(begin, end, views[worker]);
    });
    Views all;
    for (const Views& each : views) std::ranges::copy(each, std::back_inserter(all));
    renderers_[0]->renderBatch(all);
    inPortions(indices.size(),
               [&](std::size_t, std::size_t begin, std::size_t end) { to_the_end(begin, end); });
  }
  for (std::size_t i = 0; i < indices.size(); ++i) {
    if (!failures[i]) store(indices[i], outcomes[i]);
  }
  for (std::size_t i = 0; i < indices.size(); ++i) {
    if (!failures[i]) continue;
    if (size() == 1) std::rethrow_exception(failures[i]);
    try {
      std::rethrow_exception(failures[i]);
    } catch (...) {
      rethrowOfApp(indices[i]);
    }
  }
}

void AppBatch::reset(std::span<const int> indices, std::span<const RoundStart> starts,
                     std::span<const xr::DeviceState> devices) {
  if (starts.size() != indices.size() || devices.size() != indices.size()) {
    throw InvalidArgument("starts", fmt::format("{} and {} devices", starts.size(), devices.size()),
                          fmt::format("{}, one for each app", indices.size()));
  }
  std::vector<Outcome> begun(indices.size());
  run(
      indices, [&](std::size_t i) { begun[i] = at(indices, i).begin(starts[i], devices[i]); },
      [&](std::size_t i) { return begun[i]; });
}

void AppBatch::step(std::span<const int> indices, std::span<const FrameInput> frames, int drawn) {
  if (indices.empty()) return;
  const std::size_t each = frames.size() / indices.size();
  if (each == 0 || each * indices.size() != frames.size()) {
    throw InvalidArgument("frames", std::to_string(frames.size()),
                          fmt::format("a multiple of the {} apps", indices.size()));
  }
  run(
      indices,
      [&](std::size_t i) { at(indices, i).startStep(frames.subspan(i * each, each), drawn); },
      [&](std::size_t i) { return at(indices, i).finishStep(); });
}

void AppBatch::load(int index, const std::string& state) {
  app(index).load(state);
  separateChannels(index);
  fillPrivileged(index, privileged_);
  fillPrivileged(index, privileged_drawn_);
  countEvents(index);
  fillLog(index);
}

void AppBatch::addFovea(int index, std::vector<render::ViewRequest>& views) {
  const auto row = static_cast<std::size_t>(index);
  const render::ImageSize size = settings_.fovea_size;
  const double half_x = 0.5 * size.width * settings_.fovea_pixel_m;
  const double half_y = 0.5 * size.height * settings_.fovea_pixel_m;
  const double right = gaze_[2 * row], up = gaze_[2 * row + 1];
  const std::size_t pixels = size.pixels();
  apps_[row]->addWindow(
      views,
      {.left = right - half_x, .right = right + half_x, .down = up - half_y, .up = up + half_y},
      size, std::span(fovea_).subspan(row * pixels * kImageChannels, pixels * kImageChannels),
      std::span(fovea_depth_).subspan(row * pixels, pixels));
}

void AppBatch::separateChannels(int index) {
  const auto row = static_cast<std::size_t>(index);
  const std::size_t pixels = settings_.app.headset_size.pixels();
  const auto eyes = static_cast<std::size_t>(settings_.app.eyes);
  std::size_t plane = row * eyes * settings_.vision_channels.size();
  for (std::size_t eye = 0; eye < eyes; ++eye) {
    const std::uint8_t* image = &images_[(row * eyes + eye) * pixels * kImageChannels];
    for (const int channel : settings_.vision_channels) {
      const std::uint8_t* in = image + channel;
      std::uint8_t* out = &vision_[plane++ * pixels];
      for (std::size_t i = 0; i < pixels; ++i) out[i] = in[i * kImageChannels];
    }
  }
}

void AppBatch::fillPrivileged(int index, std::span<float> rows) {
  const std::size_t width = privilegedNames().size();
  if (width == 0) return;
  const auto row = static_cast<std::size_t>(index);
  apps_[row]->fillPrivileged(rows.subspan(row * width, width));
}

void AppBatch::store(int index, const Outcome& outcome) {
  const auto row = static_cast<std::size_t>(index);
  rewards_[row] = outcome.reward;
  finished_[row] = outcome.finished ? 1 : 0;
  time_features_[row] = outcome.time_feature;
  countEvents(index);
  fillLog(index);
}

void AppBatch::countEvents(int index) {
  const auto row = static_cast<std::size_t>(index);
  const Events& events = apps_[row]->events();
  haptic_counts_[row] = static_cast<std::int32_t>(events.haptics.size());
  sound_counts_[row] = static_cast<std::int32_t>(events.sounds.size());
}

void AppBatch::fillLog(int index) {
  const auto row = static_cast<std::size_t>(index);
  const std::map<std::string, double>& log = apps_[row]->log();
  if (log_names_.empty()) {
    for (const auto& entry : log) log_names_.push_back(entry.first);
    logs_.resize(apps_.size() * log_names_.size());
  }
  // Every round of a game has the same names.
  if (log.size() != log_names_.size()) {
    throw EngineError(fmt::format("app {}: a log of {} numbers where other rounds have {}", index,
                                  log.size(), log_names_.size()));
  }
  std::size_t column = row * log_names_.size();
  for (const auto& entry : log) logs_[column++] = entry.second;
}

}  // namespace sim2vr::runtime

#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

#include "layer.hpp"
#include "sim2vr/xr/frames.hpp"

namespace sim2vr::openxr::layer {
namespace {

using nlohmann::json;

/// Position and rotation in the app's frame.
json row(const XrPosef& pose) {
  const Pose app = xr::fromXr(pose);
  return {app.position.x(), app.position.y(), app.position.z(), app.rotation.x(),
          app.rotation.y(), app.rotation.z(), app.rotation.w()};
}

/// Columns of xr::kInputColumns; touches are not read.
json inputs(const xr::ControllerState& hand) {
  const auto digital = [](bool pressed) { return pressed ? 1 : 0; };
  return {hand.trigger,
          hand.squeeze,
          hand.thumbstick.x,
          hand.thumbstick.y,
          digital(hand.thumbstick_click),
          digital(hand.a || hand.x),
          digital(hand.b || hand.y),
          digital(hand.menu),
          0,
          0,
          0,
          0,
          0};
}

}  // namespace

void say(const char* what, const char* detail) {
  std::fprintf(stderr, "sim2vr OpenXR layer: %s%s\n", what, detail);
}

Recording::Recording(int file, const std::string& application) : file_(file), waiting_(kWaiting) {
  const std::string header = json{{"format", "sim2vr-session"},
                                  {"version", 1},
                                  {"app", {{"kind", "app"}, {"name", application}}},
                                  {"source", "openxr"}}
                                 .dump(-1, ' ', false, json::error_handler_t::replace);
  line(header);
  // The program's signals are handled in the program's own threads.
  sigset_t all;
  sigset_t before;
  ::sigfillset(&all);
  ::pthread_sigmask(SIG_SETMASK, &all, &before);
  try {
    writer_ = std::thread([this] { work(); });
  } catch (...) {
    ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
    throw;
  }
  ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

Recording::~Recording() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  more_.notify_one();
  writer_.join();
  ::close(file_);
  if (all_.frames + all_.vibrations == 0) return;
  char text[128];
  std::snprintf(text, sizeof text, "the recording lacks %llu frames and %llu vibrations",
                static_cast<unsigned long long>(all_.frames),
                static_cast<unsigned long long>(all_.vibrations));
  char cause[192] = "";
  if (error_ != 0) {
    std::snprintf(cause, sizeof cause, ": writing the file: %s", std::strerror(error_));
  }
  say(text, cause);
}

void Recording::add(const EndedFrame& frame) {
  {
    const std::lock_guard lock(mutex_);
    if (count_ == waiting_.size()) {
      lost_.frames += 1 + frame.lost.frames;
      lost_.vibrations += frame.vibrations.count + frame.lost.vibrations;
      return;
    }
    EndedFrame& to = waiting_[(oldest_ + count_) % waiting_.size()];
    to = frame;
    to.lost.frames += lost_.frames;
    to.lost.vibrations += lost_.vibrations;
    lost_ = {};
    ++count_;
  }
  more_.notify_one();
}

void Recording::lose(const Lost& lost) {
  const std::lock_guard lock(mutex_);
  lost_.frames += lost.frames;
  lost_.vibrations += lost.vibrations;
}

void Recording::work() {
  const auto count = [this](const Lost& lost) {
    for (Lost* sum : {&unwritten_, &all_}) {
      sum->frames += lost.frames;
      sum->vibrations += lost.vibrations;
    }
  };
  std::unique_lock lock(mutex_);
  for (;;) {
    more_.wait(lock, [this] { return closing_ || count_ > 0; });
    if (count_ == 0) break;
    const EndedFrame frame = waiting_[oldest_];
    oldest_ = (oldest_ + 1) % waiting_.size();
    --count_;
    lock.unlock();
    count(frame.lost);
    try {
      write(frame);
    } catch (const std::exception&) {
      count({1, frame.vibrations.count});
    }
    lock.lock();
  }
  count(lost_);
  try {
    writeLost(latest_);
  } catch (const std::exception& error) {
    say("what the recording lacks is not written: ", error.what());
  }
}

void Recording::writeLost(XrTime time) {
  if (unwritten_.frames + unwritten_.vibrations == 0) return;
  const json data{{"frames", unwritten_.frames}, {"vibrations", unwritten_.vibrations}};
  if (line(json{{"t", time}, {"event", "lost"}, {"data", data}}.dump())) unwritten_ = {};
}

void Recording::write(const EndedFrame& frame) {
  if (first_ == 0) first_ = frame.time;
  const XrTime time = std::max(latest_, frame.time - first_);
  json entry{{"t", time}, {"head", row(frame.head)}};
  for (std::size_t i = 0; i < frame.hands.size(); ++i) {
    const xr::ControllerState& hand = frame.hands[i];
    if (!hand.active) continue;
    entry[i == 0 ? "left" : "right"] = {
        {"grip", row(hand.grip)}, {"aim", row(hand.aim)}, {"inputs", inputs(hand)}};
  }
  std::string text = entry.dump();
  for (std::size_t i = 0; i < frame.vibrations.count; ++i) {
    const Vibration& vibration = frame.vibrations.each[i];
    text += '\n';
    text += json{{"t", time},
                 {"event", "haptic"},
                 {"data",
                  {{"hand", vibration.hand == xr::Hand::left ? "left" : "right"},
                   {"amplitude", vibration.amplitude},
                   {"frequency_hz", vibration.frequency_hz},
                   // The shortest that the device can is -1 ns, as in OpenXR.
                   {"duration_s", static_cast<double>(vibration.duration_ns) * 1e-9}}}}
                .dump();
  }
  writeLost(time);
  latest_ = time;
  if (line(std::move(text))) return;
  all_.frames += 1;
  all_.vibrations += frame.vibrations.count;
}

bool Recording::line(std::string text) {
  if (error_ != 0) return false;
  text += '\n';
  // At once: a program that is killed leaves whole lines.
  for (std::size_t done = 0; done < text.size();) {
    const ssize_t n = ::write(file_, text.data() + done, text.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      error_ = n < 0 ? errno : ENOSPC;
      // Without the piece of a line, what was recorded before can be read.
      const off_t end = ::lseek(file_, 0, SEEK_CUR);
      if (end >= 0 && ::ftruncate(file_, end - static_cast<off_t>(done)) != 0) return false;
      return false;
    }
    done += static_cast<std::size_t>(n);
  }
  return true;
}

}  // namespace sim2vr::openxr::layer

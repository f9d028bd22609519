// SPDX-License-Identifier: Apache-2.0
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "layer.hpp"
#include "sim2vr/xr/frames.hpp"

namespace sim2vr::openxr::layer {
namespace {

/// A line of JSON in memory of fixed size. Libraries for JSON allocate, even where they tidy up
/// after a failed allocation, and end the program then.
class Line {
 public:
  Line& operator<<(std::string_view text) {
    const std::size_t count = std::min(text.size(), text_.size() - size_);
    std::copy_n(text.data(), count, text_.data() + size_);
    size_ += count;
    return *this;
  }
  Line& operator<<(double number) {
    if (!std::isfinite(number)) return *this << "null";
    return written(number);
  }
  Line& operator<<(std::int64_t number) { return written(number); }
  Line& operator<<(std::uint64_t number) { return written(number); }
  std::string_view text() const { return {text_.data(), size_}; }

 private:
  template <class Number>
  Line& written(Number number) {
    char* end = text_.data() + text_.size();
    size_ = static_cast<std::size_t>(std::to_chars(text_.data() + size_, end, number).ptr -
                                     text_.data());
    return *this;
  }
  /// A frame with 16 vibrations needs less than half of it.
  std::array<char, 8192> text_;
  std::size_t size_ = 0;
};

/// Position and rotation in the app's frame.
void row(Line& line, const XrPosef& pose) {
  const Pose app = xr::fromXr(pose);
  line << "[" << double{app.position.x()} << "," << double{app.position.y()} << ","
       << double{app.position.z()} << "," << double{app.rotation.x()} << ","
       << double{app.rotation.y()} << "," << double{app.rotation.z()} << ","
       << double{app.rotation.w()} << "]";
}

/// Columns of xr::kInputColumns; touches are not read.
void inputs(Line& line, const xr::ControllerState& hand) {
  line << "[" << double{hand.trigger} << "," << double{hand.squeeze} << ","
       << double{hand.thumbstick.x} << "," << double{hand.thumbstick.y};
  for (const bool pressed :
       {hand.thumbstick_click, hand.a || hand.x, hand.b || hand.y, hand.menu}) {
    line << (pressed ? ",1" : ",0");
  }
  line << ",0,0,0,0,0]";
}

/// Bytes of the character that `text` begins with; 0: it is no UTF-8.
std::size_t character(std::string_view text) {
  const auto byte = [&](std::size_t i) {
    return i < text.size() ? static_cast<unsigned char>(text[i]) : 0U;
  };
  const unsigned lead = byte(0);
  if (lead < 0x80) return 1;
  const std::size_t size = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : 2;
  unsigned least = 0x80;
  unsigned most = 0xBF;
  if (lead < 0xC2 || lead > 0xF4) return 0;
  if (lead == 0xE0) least = 0xA0;
  if (lead == 0xED) most = 0x9F;
  if (lead == 0xF0) least = 0x90;
  if (lead == 0xF4) most = 0x8F;
  if (byte(1) < least || byte(1) > most) return 0;
  for (std::size_t i = 2; i < size; ++i) {
    if (byte(i) < 0x80 || byte(i) > 0xBF) return 0;
  }
  return size;
}

void quoted(Line& line, std::string_view text) {
  line << "\"";
  while (!text.empty()) {
    const std::size_t size = character(text);
    const char first = text.front();
    if (size == 0 || (first >= 0 && first < ' ')) {
      line << "?";
    } else {
      if (first == '"' || first == '\\') line << "\\";
      line << text.substr(0, size);
    }
    text.remove_prefix(std::max<std::size_t>(size, 1));
  }
  line << "\"";
}

}  // namespace

void say(const char* what, const char* detail) {
  std::fprintf(stderr, "sim2vr OpenXR layer: %s%s\n", what, detail);
}

Recording::Recording(int file, const std::string& application) : file_(file), waiting_(kWaiting) {
  Line header;
  header << R"({"format":"sim2vr-session","version":1,"app":{"kind":"app","name":)";
  quoted(header, application);
  header << R"(},"source":"openxr"})" << "\n";
  write(header.text());
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
    write(frame);
    lock.lock();
  }
  count(lost_);
  writeLost(latest_);
}

void Recording::writeLost(XrTime time) {
  if (unwritten_.frames + unwritten_.vibrations == 0) return;
  Line line;
  line << R"({"t":)" << time << R"(,"event":"lost","data":{"frames":)" << unwritten_.frames
       << R"(,"vibrations":)" << unwritten_.vibrations << "}}\n";
  if (write(line.text())) unwritten_ = {};
}

void Recording::write(const EndedFrame& frame) {
  if (first_ == 0) first_ = frame.time;
  const XrTime time = std::max(latest_, frame.time - first_);
  Line line;
  line << R"({"t":)" << time << R"(,"head":)";
  row(line, frame.head);
  for (std::size_t i = 0; i < frame.hands.size(); ++i) {
    const xr::ControllerState& hand = frame.hands[i];
    if (!hand.active) continue;
    line << (i == 0 ? R"(,"left":{"grip":)" : R"(,"right":{"grip":)");
    row(line, hand.grip);
    line << R"(,"aim":)";
    row(line, hand.aim);
    line << R"(,"inputs":)";
    inputs(line, hand);
    line << "}";
  }
  line << "}\n";
  for (std::size_t i = 0; i < frame.vibrations.count; ++i) {
    const Vibration& vibration = frame.vibrations.each[i];
    line << R"({"t":)" << time << R"(,"event":"haptic","data":{"hand":)"
         << (vibration.hand == xr::Hand::left ? R"("left")" : R"("right")") << R"(,"amplitude":)"
         << double{vibration.amplitude} << R"(,"frequency_hz":)"
         << double{vibration.frequency_hz}
         // The shortest that the device can is -1 ns, as in OpenXR.
         << R"(,"duration_s":)" << static_cast<double>(vibration.duration_ns) * 1e-9 << "}}\n";
  }
  writeLost(time);
  latest_ = time;
  if (write(line.text())) return;
  all_.frames += 1;
  all_.vibrations += frame.vibrations.count;
}

bool Recording::write(std::string_view text) {
  if (error_ != 0) return false;
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

// SPDX-License-Identifier: Apache-2.0
// The conversation with the harness, and the watch over the program that must not stall it.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "api.hpp"
#include "sim2vr/wire/numbers.hpp"
#include "sim2vr/wire/shared_images.hpp"
#include "sim2vr/xr/tracking.hpp"

namespace sim2vr::openxr {

inline constexpr std::int64_t kSecond_ns = 1'000'000'000;

// What runtime and harness say to each other over the program's socket: u32 length, u8 kind, body;
// little-endian. Decoding throws wire::MalformedMessage.

inline constexpr std::uint32_t kMaximumMessageBytes = 1U << 20U;
inline constexpr std::uint32_t kMaximumFrames = 1000;

enum class MessageKind : std::uint8_t {
  hello = 1,
  config,
  session,
  accepted,
  step,
  answer,
  quit,
  ended,
  error
};

struct Message {
  MessageKind kind{};
  std::string body;
};

/// What the simulated headset is.
struct Config {
  std::uint32_t width = 1024;
  std::uint32_t height = 1024;
  double ipd_m = 0.064;
  double vertical_fov_deg = 90.0;
  double frame_rate_hz = 90.0;
  bool images = false;
  bool depth = false;
  std::uint32_t eyes = 2;
  bool left_hand = true;
  bool right_hand = true;
  std::string profile = "/interaction_profiles/oculus/touch_controller";
  bool pipelined = false;
  double timeout_s = 10.0;
  XrTime start_time_ns = 1;
  double farthest_m = 10.0;

  std::size_t eyeBytes() const { return static_cast<std::size_t>(width) * height * 4; }
  XrDuration period_ns() const { return static_cast<XrDuration>(1e9 / frame_rate_hz); }
  XrFovf fov() const { return xr::eyeFov(vertical_fov_deg, static_cast<double>(width) / height); }
};

/// Of the program, as it says itself.
struct Hello {
  std::string application;
  std::uint32_t application_version = 0;
  std::string engine;
  std::uint32_t engine_version = 0;
  XrVersion api_version = kVersion10;
  std::vector<std::string> extensions;
  std::int64_t pid = 0;
};

struct SessionFacts {
  std::string graphics;
  bool depth_layers = false;
  std::uint64_t image_bytes = 0;  // of the memory that comes with the message; 0: none
};

struct Step {
  std::vector<xr::Frame> frames;
  bool image_wanted = false;
};

struct Event {
  std::string kind;  // haptic, state, label
  std::string text;  // hand, state or label
  float amplitude = 0.0F;
  float frequency_hz = 0.0F;
  XrDuration duration_ns = 0;
  XrTime time_ns = 0;
};

struct Answer {
  std::uint32_t frames_shown = 0;
  bool has_image = false;
  bool has_depth = false;
  bool should_render = true;
  std::uint32_t layers = 0;
  std::vector<Event> events;
  std::string note;
};

Config decodeConfig(std::string_view body);
/// The "error" of an error message; the body as it is where it has none.
std::string decodeError(std::string_view body);
/// Poses become OpenXR's; frames have growing times above 0 (the caller checks them against the
/// previous step's).
Step decodeStep(std::string_view body);

std::string encodeHello(const Hello& hello);
std::string encodeSession(const SessionFacts& facts);
std::string encodeAnswer(const Answer& answer);
std::string encodeEnded(std::string_view reason, std::string_view call);

// The socket to the harness.

/// The harness closed its end, or the socket failed.
class ChannelClosed : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// One end of a stream socket, which it does not own.
class Channel {
 public:
  explicit Channel(int socket) : socket_(socket) {}
  int socket() const { return socket_; }

  /// Thread-safe. `file`: a descriptor that the other side gets with the message; -1: none. Throws
  /// ChannelClosed.
  void send(MessageKind kind, std::string_view body, int file = -1);
  /// Blocks for a whole message. Throws ChannelClosed, and wire::MalformedMessage for a length
  /// above kMaximumMessageBytes or an unknown kind.
  Message receive();
  /// From now on receive() throws ChannelClosed where nothing comes for `seconds` of real time; 0:
  /// it waits for ever.
  void limit(double seconds);
  /// Wakes a thread in receive().
  void shutdown();

 private:
  void read(char* to, std::size_t bytes);

  int socket_;
  double limit_s_ = 0.0;
  std::mutex sending_;
};

// Time that a preloaded virtual clock does not touch: the kernel's own, asked past the C library.

/// CLOCK_MONOTONIC of the machine.
std::int64_t realNow_ns();
void realSleep(std::int64_t duration_ns);

/// Wakes a thread that waits for it, now or later.
class Bell {
 public:
  Bell();
  ~Bell();
  Bell(const Bell&) = delete;
  Bell& operator=(const Bell&) = delete;
  void ring();
  /// Until it rings, for the duration at most.
  void wait(std::int64_t duration_ns) const;

 private:
  int event_;
};

/// What the last frames of a step looked like: `eyes` images of RGBA, A = depth.
struct Picture {
  std::vector<std::uint8_t> rgba;
  bool has_image = false;
  bool has_depth = false;
};

/// Most seconds from hello to the configuration, and from session to its acceptance, during which
/// no other call of the program gets on. Long, as a program that was started for the next round is
/// answered between the steps of this one, and a user may learn for minutes there.
inline constexpr double kGreeting_s = 600.0;

class Harness {
 public:
  /// Says hello over the socket of SIM2VR_OPENXR_SOCKET and waits for the configuration. nullptr
  /// where the variable is not set. Throws Failure (XR_ERROR_RUNTIME_UNAVAILABLE).
  static std::shared_ptr<Harness> connect(const Hello& hello);
  Harness(int socket, const Hello& hello, double greeting_s = kGreeting_s);
  ~Harness();

  const Config& config() const { return config_; }

  /// Throws Failure (XR_ERROR_RUNTIME_FAILURE) with the harness's reason against it.
  void openSession(std::string_view graphics, bool depth_layers);

  /// Blocks for the next step; nothing: quit. Throws ChannelClosed and wire::MalformedMessage.
  std::optional<Step> nextStep();
  void answer(Answer answer, const Picture& picture);
  /// For the next answer.
  void note(Event event);
  /// Tells the harness why it gets no further answers. Never throws.
  void ended(std::string_view reason, std::string_view call);

  /// From now on `call` has to come within the configuration's timeout; otherwise the harness is
  /// sent `ended` with "CAUSE within 10 s", and lost() becomes true.
  void expect(const char* call, const char* cause);
  void relax();
  bool lost() const { return lost_; }
  /// Ends the watch. Not under the world's lock: the watch takes it to wake what waits.
  void stopWatching();
  void lose() { lost_ = true; }

 private:
  void watch();

  Channel channel_;
  double greeting_s_;
  Config config_;
  std::unique_ptr<wire::SharedImages> images_;
  XrTime latest_ = 0;
  std::vector<Event> events_;
  std::atomic<bool> lost_{false};
  std::atomic<bool> told_{false};

  std::mutex watching_;
  std::optional<std::int64_t> deadline_ns_;
  const char* call_ = "";
  const char* cause_ = "";
  std::atomic<bool> closing_{false};
  Bell bell_;
  std::thread watchman_;
};

}  // namespace sim2vr::openxr

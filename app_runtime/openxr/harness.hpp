// SPDX-License-Identifier: Apache-2.0
// The conversation with the harness, and the watch over the program that must not stall it.
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "channel.hpp"
#include "messages.hpp"
#include "real_time.hpp"
#include "sim2vr/wire/shared_images.hpp"

namespace sim2vr::openxr {

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
